"""The place where to hold the board next before a rig, and how accurate the rig would be.

The guide takes the placement that lowers the error of the pair's disparity most: where one camera
sees what another looks at, over their overlap and the depths. Once that is small enough, it asks
for what each camera's own picture lacks, by the plain rule.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.io.numerals import counted
from calib.planning.hints import placement_hint
from calib.planning.pose_bank import (
    Reach,
    fit_bare_pose,
    has_enough_corners,
    make_pose_bank,
    outline,
)
from calib.session.board import Board
from calib.session.camera import Camera
from capture.coverage import KeptView, PlainGuide, upright
from capture.rig.moment_gate import Corners
from capture.rig.rig_information import (
    RigModel,
    choose_placement,
    compose_poses,
    disparity_sigma,
    invert_pose,
)
from capture.rig.rig_start import estimate_lens, estimate_mountings

Array = NDArray[np.float64]

TARGET_PX = 0.1
"""px: a predicted error of the disparity that is good enough, as for the maps of one camera; what a
matcher adds is larger.
"""
MAX_PLANNED = 24
"""The number of placements that are planned ahead."""
MAX_CANDIDATES = 125
"""The number of placements from each camera's bank that are candidates: all of them take twice
as long, and save one view of eight.
"""
SAME_SQUARES = 1.0
"""Squares, RMS: a placement nearer to one of the session is not proposed."""
NO_COMMON_VIEW = (
    "No view is shared yet: hold the board still where all cameras see the whole of it."
)


@dataclass(frozen=True, slots=True, eq=False)
class RigHint:
    """The place where the person should hold the board next."""

    outlines: Mapping[str, Array]
    """(N, 2) px, the board's outline in the picture of each camera that is to see it."""
    instruction: str
    """An instruction, such as: far (1.2 m), to the left edge, tilt the right side away."""


@dataclass(frozen=True, slots=True)
class RigProgress:
    """The progress of the rig's recording."""

    sentence: str
    sigma_px: float | None
    """The predicted error of the disparity; None without a shared view."""
    is_enough: bool


Advice = tuple[RigHint | None, RigProgress]
"""Where to hold the board next, None if no place is asked for, and the progress."""


@dataclass(frozen=True, slots=True, eq=False)
class _Bank:
    """P placements that a person can reach."""

    placements: Array
    """(P, 6) T_reference_board."""
    pixels: Mapping[str, Array]
    """(P, count, 2) px by camera, NaN where the camera does not see the board well enough."""
    information: Array
    """(P, S, S)"""


class RigGuide:
    """A guide for the views of a rig. It computes for some tenths of a second."""

    def __init__(self, board: Board, cameras: Mapping[str, Camera]) -> None:
        """`cameras` are those of the sessions, without intrinsics where these are unknown."""
        self._board = board
        self._cameras = cameras

    def advise(self, views: Sequence[Corners]) -> Advice:
        """Return the advice for a rig with these views."""
        cameras = {
            name: estimate_lens(self._board, camera, [v[name] for v in views if name in v])
            for name, camera in self._cameras.items()
        }
        mountings = estimate_mountings(self._board, cameras, views)
        if mountings is None:
            return None, RigProgress(NO_COMMON_VIEW, None, is_enough=False)
        model = RigModel(self._board, cameras, mountings)
        levels = [Reach.of(self._board, camera) for camera in cameras.values()]
        reach = Reach(min(r.near for r in levels), max(r.far for r in levels))
        derivatives = model.disparity_derivatives(reach.levels())
        precision = np.diag(model.prior_sigma() ** -2.0) + self._gathered(model, views)
        sigma = disparity_sigma(derivatives, precision)
        bank = self._bank(model)
        plan = self._plan(bank, derivatives, precision, views)
        if not plan or sigma <= TARGET_PX:
            return self._advise_single(cameras, views, sigma)
        for index in plan:
            precision = precision + bank.information[index]
        reached = disparity_sigma(derivatives, precision)
        return (
            self._hint(model, bank, plan[0], reach),
            RigProgress(_sentence(sigma, reached, len(plan)), sigma, is_enough=False),
        )

    def _advise_single(
        self, cameras: Mapping[str, Camera], views: Sequence[Corners], sigma: float
    ) -> Advice:
        """Return the advice once the rig's own error is small: what the picture of each camera
        lacks.
        """
        estimate = f"The disparity is likely off by {sigma:.2f} px; the goal is {TARGET_PX:.2f} px"
        for name, camera in cameras.items():
            guide = PlainGuide(self._board, camera)
            camera_views = [KeptView(view[name]) for view in views if name in view]
            hint = guide.next_pose(camera_views)
            if hint:
                needed = guide.progress(camera_views).views_needed or 0
                sentence = (
                    f"{estimate}. The picture of {name} lacks about {needed}"
                    f" view{'s' * (needed != 1)}, which may show the board to it alone."
                )
                return (
                    RigHint({name: hint.outline}, f"for {name}: {hint.instruction}"),
                    RigProgress(sentence, sigma, is_enough=False),
                )
        return None, RigProgress(f"Enough: {estimate.lower()}.", sigma, is_enough=True)

    def _gathered(self, model: RigModel, views: Sequence[Corners]) -> Array:
        """Return the (S, S) information of the session's views."""
        total = np.zeros((model.count, model.count))
        for view in views:
            name = next(camera for camera in model.cameras if camera in view)
            pose = fit_bare_pose(self._board, model.cameras[name], view[name])
            if pose is not None:
                visible = {camera: np.isfinite(view[camera][:, 0]) for camera in view}
                total += model.information(
                    compose_poses(invert_pose(model.mountings[name]), pose), visible
                )
        return total

    def _bank(self, model: RigModel) -> _Bank:
        """Return the placements at which some camera sees the board as its own bank has it."""
        placements = []
        for name, camera in model.cameras.items():
            to_reference = invert_pose(model.mountings[name])
            bank = make_pose_bank(self._board, camera, Reach.of(self._board, camera))
            stride = max(len(bank.poses) // MAX_CANDIDATES, 1)
            placements += [compose_poses(to_reference, pose) for pose in bank.poses[::stride]]
        pixels: dict[str, list[Array]] = {name: [] for name in model.cameras}
        information = []
        for placement in placements:
            visible = {}
            for name in model.cameras:
                corners = model.project(name, placement)
                enough = bool(has_enough_corners(corners[None], self._board)[0])
                pixels[name].append(corners if enough else np.full_like(corners, np.nan))
                if enough:
                    visible[name] = np.isfinite(corners[:, 0])
            information.append(model.information(placement, visible))
        return _Bank(
            np.array(placements),
            {name: np.array(corners) for name, corners in pixels.items()},
            np.array(information),
        )

    def _plan(
        self, bank: _Bank, derivatives: Array, precision: Array, views: Sequence[Corners]
    ) -> list[int]:
        """Return the placements to take, in order, until the disparity's error is small."""
        remaining = np.flatnonzero(~self._refused(bank, views)).tolist()
        plan: list[int] = []
        while (
            remaining
            and len(plan) < MAX_PLANNED
            and disparity_sigma(derivatives, precision) > TARGET_PX
        ):
            best = choose_placement(derivatives, precision, bank.information, remaining)
            plan.append(best)
            remaining.remove(best)
            precision = precision + bank.information[best]
        return plan

    def _refused(self, bank: _Bank, views: Sequence[Corners]) -> NDArray[np.bool_]:
        """Return (P,), true for a placement that the session has already."""
        refused = np.zeros(len(bank.placements), bool)
        for view in views:
            near = np.ones(len(bank.placements), bool)
            for name, pixels in bank.pixels.items():
                is_visible = np.isfinite(pixels[..., 0]).any(1)
                if name not in view:
                    near &= ~is_visible
                    continue
                corners = upright(view[name], self._board)
                grid = pixels.reshape(len(pixels), self._board.rows, self._board.columns, 2)
                side = np.linalg.norm(np.diff(grid, axis=2), axis=-1).reshape(len(pixels), -1)
                with np.errstate(invalid="ignore"):
                    square = np.nansum(side, 1) / np.maximum(np.isfinite(side).sum(1), 1)
                    distance = ((pixels - corners) ** 2).sum(2)
                    count = np.maximum(np.isfinite(distance).sum(1), 1)
                    near &= np.nansum(distance, 1) / count < (SAME_SQUARES * square) ** 2
            refused |= near
        return refused

    def _hint(self, model: RigModel, bank: _Bank, index: int, reach: Reach) -> RigHint:
        corners = {
            name: pixels[index]
            for name, pixels in bank.pixels.items()
            if np.isfinite(pixels[index]).any()
        }
        outlines = {name: outline(pixels, self._board) for name, pixels in corners.items()}
        name = next(iter(outlines))
        camera = model.cameras[name]
        pose = compose_poses(model.mountings[name], bank.placements[index])
        instruction = placement_hint(
            pose,
            outlines[name],
            (camera.width, camera.height),
            None,
            (reach.near, reach.far),
        )
        together = " and ".join(outlines) if len(outlines) > 1 else f"{name} alone"
        return RigHint(outlines, f"for {together}, in the picture of {name}: {instruction}")


def _sentence(sigma: float, reached: float, planned: int) -> str:
    estimate = f"The disparity is likely off by {_px(sigma)} px; the goal is {TARGET_PX:.2f} px"
    if reached > TARGET_PX:
        return f"{estimate}; {counted(planned, 'more view')} would make it {_px(reached)}."
    return f"{estimate}: about {counted(planned, 'more view')}."


def _px(value: float) -> str:
    return f"{value:.2f}" if value < 10 else f"{value:.0f}"

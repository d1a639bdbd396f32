"""The start of a rig's estimate: how the cameras are mounted, from the board's poses in each.

A board without markers looks the same after half a turn, a square one after a quarter turn. Each
picture that two cameras share gives a mounting for each turn. The right ones agree from picture to
picture; the wrong ones do not, if the board is tilted in different ways. The mounting on which most
pictures agree is the start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.optics import rotation
from calib.rig.mounting_agreement import (
    MountingAgreement,
    describe_other_pairing,
    turn_poses,
    turn_steps,
)
from calib.rig.placements import Indices, Placements
from calib.rig.poses import compose, invert_poses
from calib.session.board import Board

MAX_RIVAL = 0.7
"""The largest number of pictures that agree on another mounting, as a fraction of those that agree
on the best: more, and the pictures do not tell them apart.
"""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RigStart:
    """The start of a joint estimate."""

    mountings: Mapping[str, Tensor]
    """(6,) T_camera_reference of each camera."""
    placements: Tensor
    """(P, 6) T_reference_board."""
    turns: Mapping[str, Indices]
    """For each camera, (V,) the number of quarter turns by which the board of each view stands
    turned against that of the other cameras.
    """
    inconsistent: Mapping[str, NDArray[np.bool_]]
    """For each camera, (V,) true for a view whose board does not stand where the other cameras see
    it.
    """


def start_rig(
    poses: Mapping[str, Tensor], placements: Placements, reference: str, board: Board
) -> RigStart:
    """Return the start from the (V, 6) T_camera_board of each camera's views.

    Raises:
        NotEnoughDataError: a camera shares no picture of the board with the others, or they do not
            agree on its mounting, or agree on two.
    """
    steps = turn_steps(board)
    mountings = {reference: torch.zeros(6, dtype=torch.float64)}
    placed = torch.full((placements.count, 6), torch.nan, dtype=torch.float64)
    turns = {name: np.zeros(len(views), np.int64) for name, views in poses.items()}
    inconsistent = {name: np.zeros(len(views), np.bool_) for name, views in poses.items()}
    _place(placed, poses[reference], placements.of_views[reference])
    while len(mountings) < len(poses):
        is_placed = torch.isfinite(placed[:, 0]).numpy()
        shared = {
            name: int(is_placed[placements.of_views[name]].sum())
            for name in poses
            if name not in mountings
        }
        name = max(shared, key=lambda camera: shared[camera])
        if not shared[name]:
            raise NotEnoughDataError(
                f"No picture of {name} shows the board at the same moment as a picture of"
                f" {', '.join(mountings)}: take some where they see it together, or correct"
                " together in rig.yaml."
            )
        place = placements.of_views[name]
        common = np.flatnonzero(is_placed[place])
        views = poses[name][common]
        mounting, quarters, agrees = _mounting(views, placed[place[common]], steps, name)
        mountings[name] = mounting
        turns[name][common] = quarters
        inconsistent[name][common] = ~agrees
        turned = compose(poses[name], turn_poses(turns[name]))
        usable = torch.from_numpy(~inconsistent[name])
        placed_poses = compose(invert_poses(mounting), turned)
        _place(placed, placed_poses[usable], place[usable.numpy()])
    return RigStart(mountings, placed, turns, inconsistent)


def turn_view(view: View, board: Board, quarters: int) -> View:
    """Return the view with its corners in the order of a board that is not turned.

    Args:
        quarters: the quarter turns about the board's z axis by which it stands turned.
    """
    if not quarters % 4:
        return view
    turn = rotation.matrix(turn_poses(np.array([quarters]))[0, :3]).numpy()[:2, :2]
    points = board.points()
    distances = np.linalg.norm((points @ turn.T)[:, None] - points, axis=-1)
    order = distances.argmin(1)
    blur = view.blur
    if blur is not None:
        blur = blur[order][:, ::-1] if quarters % 2 else blur[order]
    return replace(
        view,
        corners=view.corners[order],
        weight=view.weight[order],
        covariance=None if view.covariance is None else view.covariance[order],
        blur=blur,
    )


def nearest_turns(poses: Tensor, expected: Tensor, board: Board) -> tuple[Indices, Tensor]:
    """Return the (V,) quarter turns by which the boards of (V, 6) poses stand turned against the
    expected (V, 6) poses, and the poses without these turns. A view whose expected pose is NaN
    counts as not turned.
    """
    steps = turn_steps(board)
    candidates = torch.stack(
        [compose(poses, turn_poses(np.full(len(poses), step))) for step in steps], 1
    )
    turns = rotation.matrix(candidates[..., :3])
    trace = torch.einsum("vij,vkij->vk", rotation.matrix(expected[:, :3]), turns)
    chosen = trace.nan_to_num(0.0).argmax(-1)
    nearest = candidates[torch.arange(len(poses)), chosen]
    return np.array(steps, np.int64)[chosen.numpy()], nearest


def _place(placed: Tensor, poses: Tensor, place: Indices) -> None:
    """Set the placements that have none yet, in place."""
    for pose, index in zip(poses, place.tolist(), strict=True):
        if bool(placed[index, 0].isnan()):
            placed[index] = pose


def _mounting(
    views: Tensor, placements: Tensor, steps: Sequence[int], name: str
) -> tuple[Tensor, Indices, NDArray[np.bool_]]:
    """Return the (6,) mounting on which most views agree, the quarter turns of each view, and true
    for each view that agrees.

    Args:
        views: (V, 6) T_camera_board.
        placements: (V, 6) T_reference_board.
        steps: the possible quarter turns.
    """
    agreement = MountingAgreement.of(views, placements, steps)
    candidates, deviations = agreement.candidates, agreement.deviations
    agrees, best = agreement.agreeing, agreement.best
    if agreement.is_contradictory:
        advice = describe_other_pairing(views, placements, steps, name)
        raise NotEnoughDataError(
            f"Only {agreement.count} of the {len(views)} pictures that {name} shares with the other"
            " cameras agree on where it is"
            + (
                f". {advice}"
                if advice
                else ": correct together in rig.yaml, or check that no camera moved in between."
            )
        )
    is_rival = deviations[best].flatten() > 4
    rivals = agrees[is_rival & (agrees > MAX_RIVAL * agrees[best])]
    if len(rivals) and len(steps) > 1:
        raise NotEnoughDataError(
            f"The board looks the same after a turn, and the pictures that {name} shares with the"
            " other cameras do not show how it stands: add pictures with the board tilted"
            " differently, or use a board with markers."
        )
    chosen = deviations[best].argmin(-1)  # (V,)
    agreeing = deviations[best].amin(-1) <= 1
    picked = candidates[torch.arange(len(views)), chosen][agreeing]
    mounting = _average(picked, candidates.flatten(0, 1)[best])
    quarters = np.array(steps, np.int64)[chosen.numpy()]
    return mounting, quarters, agreeing.numpy()


def _average(mountings: Tensor, middle: Tensor) -> Tensor:
    """Return the (6,) median of (N, 6) mountings, by components about one of them."""
    relative = compose(mountings, invert_poses(middle).expand(len(mountings), 6))
    return compose(relative.median(0).values, middle)

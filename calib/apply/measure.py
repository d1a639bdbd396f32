"""Metric measurement with one calibrated camera: points on a known plane, or triangulated from
several views of a still board. In metres, with sigma.

Sigma counts the noise of the pixels, the uncertainty of the calibration's rays, which pixels and
boards share, the noise of the corners of boards that say where a plane is, and how well the side of
their squares is known. It does not count a board of another shape, nor glass that the fit cannot
follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import torch
from numpy.typing import NDArray

from calib.apply.map_uncertainty import frames_along, ray_errors
from calib.apply.triangulate import central_differences, intersect, triangulate, turns
from calib.calibration import Calibration
from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.poses import pinhole_poses, refit_poses
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.io.array_arguments import (
    FARTHEST_M,
    FARTHEST_PX,
    indices,
    numbers,
    pixel_rows,
)
from calib.io.numerals import number
from calib.threads import single_thread
from calib.undistortion.grids import Array
from calib.undistortion.ray_field import check_depth

Indices = NDArray[np.signedinteger]
Flags = NDArray[np.bool_]

LEAST_WEIGHT = 1e-6
"""Of a corner: a detector's level 20."""
PIXEL_STEP = 0.05
"""px, of differences."""
LINE_STEPS = (0.05, 0.05, 0.05, 0.05)
"""px, px, px m, px m: of differences by A and B."""
POSE_STEPS = (1e-6,) * 6
"""rad and m"""


@dataclass(frozen=True, slots=True, eq=False)
class BoardPose:
    """T_camera_board, or where any plane is."""

    pose: Array
    """(6,) rotation vector (rad) and translation (m)."""
    noise: Array
    """(6, 6) errors for each of six independent errors of unit variance, from the noise of the
    corners.
    """
    rays: Array
    """(6, S + 1) errors for each independent error of the calibration's rays, and for that of the
    squares' side.
    """

    @staticmethod
    def exactly(pose: Array) -> BoardPose:
        return BoardPose(_pose(pose), np.zeros((6, 6)), np.zeros((6, 0)))

    @staticmethod
    def facing(depth: float) -> BoardPose:
        """A plane across the optical axis, depth m in front of the camera."""
        metres = number(depth, "depth")
        check_depth(metres)
        return BoardPose.exactly(np.array([0, 0, 0, 0, 0, metres]))


class Reason(StrEnum):
    """Why a point is not measured."""

    MEASURED = ""
    OUTSIDE = "outside the picture"
    NO_RAY = "no ray leaves the cover there"
    NO_POINT = "its ray does not reach the plane"
    NOWHERE = "its rays do not meet in front of the camera"


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """N points in one frame."""

    points: Array
    """(N, 3) m; NaN where there is a reason against it."""
    own: Array
    """(N, 3, 3) m^2: covariance from the noise of each point's own pixels."""
    shared: Array
    """(N, 3, Q) m: errors for each of Q independent errors of unit variance that points share."""
    gap_px: Array
    """(N,): how far its rays miss a triangulated point, root mean square; 0 on a plane."""
    reasons: tuple[Reason, ...]
    """N: why a point is NaN; MEASURED where it is not."""

    @property
    def sigma(self) -> Array:
        """(N, 3) m: standard deviations of x, y and z."""
        return np.asarray(np.sqrt(np.einsum("nii->ni", self.own) + (self.shared**2).sum(-1)))

    def distance(self, first: int, second: int) -> tuple[float, float]:
        """Between two points, and its sigma, m. What moves both alike does not count."""
        first, second = indices((first, second), 2, len(self.points), "the pair of points").tolist()
        apart = self.points[second] - self.points[first]
        metres = float(np.linalg.norm(apart))
        along = apart / metres if metres else np.full(3, 3**-0.5)
        variance = (
            along @ (self.own[first] + self.own[second]) @ along
            + ((along @ (self.shared[second] - self.shared[first])) ** 2).sum()
        )
        return metres, float(np.sqrt(variance))


class Measurer:
    """Measures with one calibration."""

    def __init__(self, calibration: Calibration, noise_px: float | None = None) -> None:
        """
        Args:
            calibration: of the camera.
            noise_px: per axis, of the pixels that will be measured; by default that of the
                calibration's corners.
        """
        self.calibration = calibration
        self._corner_noise = calibration.noise_px / 2**0.5
        self.noise_px = self._corner_noise if noise_px is None else number(noise_px, "noise_px")
        if not 0 <= self.noise_px < FARTHEST_PX:
            raise InputError(
                f"noise_px is {self.noise_px:g}: give the standard deviation of a pixel's"
                " coordinate, 0 or more."
            )
        self._errors = ray_errors(calibration)
        pinhole = calibration.camera.intrinsics
        assert pinhole
        self._focal = np.array([pinhole.fx.value, pinhole.fy.value])

    def board_pose(self, view: View) -> BoardPose:
        """Where the board is in a view, with the least reprojection error through the calibrated
        camera.

        Raises:
            NotEnoughDataError: the corners that are seen give no pose.
        """
        view = self._checked(view)
        usable, few = split_usable_views((view,), self.calibration.board)
        path, values = self.calibration.model()
        observations = Observations.of(usable, self.calibration.board)
        start = pinhole_poses(observations, values)
        if few or not bool(torch.isfinite(start).all()):
            reason = few[0].reason if few else "no board pose explains its corners"
            raise NotEnoughDataError(
                f"{view.name}: {reason}: take a picture that shows the whole board."
            )
        with single_thread():
            poses, _ = refit_poses(path, values, observations, start)
            seen = observations.select_rows(
                path.land(observations.pixels, values, poses[observations.view])[1] == 0
            )
            weights = pixel_weights(path, values, seen, poses, self._corner_noise)
            (landing,) = make_residual_blocks(path, Parameters.none(values), seen, weights)
            by_pose = landing.linearise(values, poses).jacobian_block.flatten(0, 1).numpy()
        try:
            noise = np.linalg.cholesky(np.linalg.inv(by_pose.T @ by_pose))
        except np.linalg.LinAlgError:
            raise NotEnoughDataError(
                f"{view.name}: no board pose explains its corners: take a picture that shows the"
                " whole board."
            ) from None
        pose, pixels = poses[0].numpy(), seen.pixels.numpy()
        each = np.broadcast_to(pose, (len(pixels), 6))
        frames = self._frames(pixels)
        by_line = central_differences(
            lambda lines: intersect(*self._rays(lines, frames), each),
            self._lines(pixels, frames),
            LINE_STEPS,
        )  # (M, 3, 4)
        errors = self._errors(pixels, frames)
        on_board = turns(pose[None])[0].T[:2] @ by_line @ errors  # (M, 2, S)
        by_map = (weights.numpy() @ on_board).reshape(len(by_pose), -1)  # (2M, S)
        by_rays = -noise @ noise.T @ by_pose.T @ by_map
        by_size = self.calibration.board.relative_sigma * np.concatenate([np.zeros(3), pose[3:]])
        return BoardPose(pose, noise, np.column_stack([by_rays, by_size]))

    def on_planes(
        self, pixels: Array, planes: Sequence[BoardPose], plane: Sequence[int]
    ) -> Measured:
        """Where pixels look on planes, in the camera frame.

        Args:
            pixels: (N, 2)
            planes: V, each the x-y plane of a board.
            plane: (N,) which of them each pixel sees.
        """
        pixels, outside = self._within(pixel_rows(pixels))
        of = indices(plane, len(pixels), len(planes), "plane")
        poses = _poses(planes)[of]
        frames = self._frames(pixels)
        lines = self._lines(pixels, frames)
        points = intersect(*self._rays(lines, frames), poses)
        by_line = central_differences(
            lambda moved: intersect(*self._rays(moved, frames), poses), lines, LINE_STEPS
        )
        by_pose = central_differences(
            lambda moved: intersect(*self._rays(lines, frames), moved), poses, POSE_STEPS
        )
        shared = self._shared(planes, of, by_pose, by_line @ self._errors(pixels, frames))
        return _measured(
            points,
            self._own(by_line, pixels, frames),
            shared,
            np.zeros(len(points)),
            outside,
            _lost(lines),
            Reason.NO_POINT,
        )

    def triangulate(
        self, pixels: Array, boards: Sequence[BoardPose], board: Sequence[int], point: Sequence[int]
    ) -> Measured:
        """Points that several views see, in the frame of the board that stands still in all of
        them: where each misses its rays least.

        Args:
            pixels: (M, 2)
            boards: V
            board: (M,) in whose view each pixel is.
            point: (M,) which of the N points it shows.
        """
        pixels, outside = self._within(pixel_rows(pixels))
        of = indices(board, len(pixels), len(boards), "board")
        which = indices(point, len(pixels), len(pixels), "point")
        groups = _groups(which)
        if not all(len(rows) for rows in groups):
            raise InputError("point leaves out a number: count the points from 0 on.")
        poses = _poses(boards)[of]
        frames = self._frames(pixels)
        lines = self._lines(pixels, frames)
        errors = self._errors(pixels, frames)
        if not groups:
            return self.on_planes(pixels, boards, of.tolist())
        parts = [
            self._triangulated(rows, pixels, poses, frames, lines, errors, boards, of)
            for rows in groups
        ]
        points, own, shared, gap = (np.concatenate(column) for column in zip(*parts, strict=True))
        refused, lost = (
            np.array([one[rows].any() for rows in groups]) for one in (outside, _lost(lines))
        )
        return _measured(points, own, shared, gap, refused, lost, Reason.NOWHERE)

    def _triangulated(
        self,
        rows: Indices,
        pixels: Array,
        poses: Array,
        frames: Array,
        lines: Array,
        errors: Array,
        boards: Sequence[BoardPose],
        of: Indices,
    ) -> tuple[Array, Array, Array, Array]:
        """One point's (1, ...) parts of Measured, from the rows of its pixels."""

        here, there = lines[rows], poses[rows]
        ray_frames = frames[rows]
        at, missed = triangulate(*self._rays(here, ray_frames), there)

        def by_one(which: int) -> tuple[Array, Array]:
            """(1, 3, 4) and (1, 3, 6) derivatives by one of the lines and one of the poses."""

            def by_its_line(moved: Array) -> Array:
                changed = np.vstack([here[:which], moved, here[which + 1 :]])
                return triangulate(*self._rays(changed, ray_frames), there)[0][None]

            def by_its_pose(moved: Array) -> Array:
                changed = np.vstack([there[:which], moved, there[which + 1 :]])
                return triangulate(*self._rays(here, ray_frames), changed)[0][None]

            one = slice(which, which + 1)
            return central_differences(by_its_line, here[one], LINE_STEPS), central_differences(
                by_its_pose, there[one], POSE_STEPS
            )

        by_line, by_pose = (
            np.concatenate(parts) for parts in zip(*map(by_one, range(len(rows))), strict=True)
        )
        own = self._own(by_line, pixels[rows], ray_frames).sum(0, keepdims=True)
        shared = self._shared(boards, of[rows], by_pose, by_line @ errors[rows]).sum(
            0, keepdims=True
        )
        return at[None], own, shared, np.sqrt((missed**2).mean(keepdims=True)) * self._focal.mean()

    def _checked(self, view: View) -> View:
        """The view, without corners outside the picture or of no weight."""
        count = self.calibration.board.count
        corners, outside = self._within(pixel_rows(view.corners, "corners"))
        weight = numbers(view.weight, (count,), "weight")
        if len(corners) != count:
            raise InputError(
                f"corners are {len(corners)} where the board has {count}: give NaN for one that"
                " is not seen."
            )
        seen = ~outside & (weight > LEAST_WEIGHT) & (weight < np.inf)
        return replace(
            view,
            corners=np.where(seen[:, None], corners, np.nan),
            weight=np.where(seen, np.minimum(weight, 1.0), 0.0),
        )

    def _within(self, pixels: Array) -> tuple[Array, Flags]:
        """(N, 2) px, those outside the picture moved to its border, and (N,) which these are. A
        border pixel ends half a pixel beyond its centre.
        """
        camera = self.calibration.camera
        last = np.array([camera.width, camera.height]) - 0.5
        outside = np.asarray(~((pixels >= -0.5) & (pixels <= last)).all(-1))  # NaN among them
        return (
            np.where(outside[:, None], np.clip(np.nan_to_num(pixels), -0.5, last), pixels),
            outside,
        )

    def _frames(self, pixels: Array) -> Array:
        """Return (N, 3, 3) rotations from the camera frame to a frame along each pixel's ray. In
        that frame a ray has A and B even beside and behind the camera.
        """
        return frames_along(self.calibration.rays(pixels)[1])

    def _lines(self, pixels: Array, frames: Array) -> Array:
        """Return (N, 4): A without the principal point (px) and B (px m) of each pixel's ray, in
        its frame.
        """
        origins, directions = self.calibration.rays(pixels)
        origins = np.einsum("nij,nj->ni", frames, origins)
        directions = np.einsum("nij,nj->ni", frames, directions)
        tangents = directions[:, :2] / directions[:, 2:]
        return np.concatenate(
            [
                self._focal * tangents,
                self._focal * (origins[:, :2] - tangents * origins[:, 2:]),
            ],
            -1,
        )

    def _rays(self, lines: Array, frames: Array) -> tuple[Array, Array]:
        """Return, in the camera frame, the (N, 3) m points where lines given by A and B cross the
        plane z = 0 of their frames, and their (N, 3) directions.
        """
        ones = np.ones((len(lines), 1))
        to_camera = frames.swapaxes(1, 2)
        origins = np.hstack([lines[:, 2:] / self._focal, 0 * ones])
        directions = np.hstack([lines[:, :2] / self._focal, ones])
        return (
            np.einsum("nij,nj->ni", to_camera, origins),
            np.einsum("nij,nj->ni", to_camera, directions),
        )

    def _own(self, by_line: Array, pixels: Array, frames: Array) -> Array:
        """(N, 3, 3) m^2 from the pixels' noise."""
        by_pixel = (
            self.noise_px
            * by_line
            @ central_differences(
                lambda moved: self._lines(moved, frames), pixels, (PIXEL_STEP, PIXEL_STEP)
            )
        )
        return np.asarray(by_pixel @ by_pixel.swapaxes(1, 2))

    def _shared(
        self, planes: Sequence[BoardPose], of: Indices, by_pose: Array, by_rays: Array
    ) -> Array:
        """(N, 3, S + 1 + 6 V) errors that points share: of the rays, directly and through the
        boards, of the squares' side, then of each board's corners.
        """
        by_rays = np.concatenate([by_rays, np.zeros((len(of), 3, 1))], -1)
        noise = np.zeros((len(of), 3, len(planes), 6))
        for row, plane in enumerate(of):
            noise[row, :, plane] = by_pose[row] @ planes[plane].noise
            if planes[plane].rays.size:
                by_rays[row] += by_pose[row] @ planes[plane].rays
        return np.concatenate([by_rays, noise.reshape(len(of), 3, -1)], -1)


def _measured(
    points: Array,
    own: Array,
    shared: Array,
    gap_px: Array,
    outside: Flags,
    lost: Flags,
    missed: Reason,
) -> Measured:
    """NaN in every part of a point that is refused (N,), has no ray (N,), or came out as NaN, which
    is `missed`.
    """
    reasons = np.select(
        [outside, lost, np.isnan(points).any(-1)],
        [Reason.OUTSIDE, Reason.NO_RAY, missed],
        Reason.MEASURED,
    ).tolist()
    bad = [bool(reason) for reason in reasons]
    for part in (points, own, shared, gap_px):
        part[bad] = np.nan
    return Measured(points, own, shared, gap_px, tuple(map(Reason, reasons)))


def _lost(lines: Array) -> Flags:
    return np.asarray(np.isnan(lines).any(-1))


def _groups(which: Indices) -> list[Indices]:
    return [np.flatnonzero(which == n) for n in range(int(which.max(initial=-1)) + 1)]


def _pose(pose: Array) -> Array:
    checked = numbers(pose, (6,), "a pose")
    if not (np.abs(checked) < FARTHEST_M).all():
        raise InputError("a pose is not finite: give a rotation vector in rad and metres.")
    return checked


def _poses(boards: Sequence[BoardPose]) -> Array:
    """(V, 6)"""
    return np.array([_pose(board.pose) for board in boards]).reshape(-1, 6)

"""Metric measurement with one calibrated camera: points on a known plane, or triangulated from
several views of a static board. Results are in metres, with sigma.

Sigma includes four parts: the noise of the pixels; the uncertainty of the calibration's rays, which
pixels and boards share; the noise of the corners of the boards that define the planes; and the
tolerance of the side of their squares. It does not include a board that is not flat, nor glass
whose shape the fit cannot describe.

A ray is a line in a frame along its direction, by two pairs of numbers. A is the tangents of its
angles to that frame's z axis, times the focal lengths (px). B is the point where it crosses the
plane z = 0, times the focal lengths (px m).
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
from calib.calibration import Calibration, CalibrationSource
from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.poses import pinhole_poses, refit_poses
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.estimation.residuals import reach_board
from calib.io.array_arguments import (
    FARTHEST_M,
    FARTHEST_PX,
    indices,
    numbers,
    pixel_rows,
)
from calib.io.numerals import real_number
from calib.threads import single_thread
from calib.undistortion.grids import Array
from calib.undistortion.ray_field import check_depth

Indices = NDArray[np.signedinteger]
Flags = NDArray[np.bool_]

MIN_WEIGHT = 1e-6
"""Corners of this weight or less are not used. A corner of a detector's level 20 has it."""
PIXEL_STEP = 0.05
"""px: the step of differences by a pixel's coordinates."""
LINE_STEPS = (0.05, 0.05, 0.05, 0.05)
"""px, px, px m, px m: the steps of differences by A and B."""
POSE_STEPS = (1e-6,) * 6
"""rad and m: the steps of differences by a pose."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardPose:
    """The pose T_camera_board of a board, or of any plane."""

    pose: Array
    """(6,) rotation vector (rad) and translation (m)."""
    noise: Array
    """(6, 6) changes of the pose, one column for each of six independent errors of unit variance.
    They are the effect of the corners' noise.
    """
    rays: Array
    """(6, S + 1) changes of the pose, one column for each independent error of the calibration's
    rays, and the last for the error of the squares' side.
    """

    @staticmethod
    def exactly(pose: Array) -> BoardPose:
        """Return a (6,) pose without errors."""
        return BoardPose(_check_pose(pose), np.zeros((6, 6)), np.zeros((6, 0)))

    @staticmethod
    def facing(depth: float) -> BoardPose:
        """Return a plane perpendicular to the optical axis, at a depth in m."""
        metres = real_number(depth, "depth")
        check_depth(metres)
        return BoardPose.exactly(np.array([0, 0, 0, 0, 0, metres]))


class UnmeasuredReason(StrEnum):
    """The reason why a point is not measured, or MEASURED."""

    MEASURED = ""
    OUTSIDE = "outside the picture"
    NO_RAY = "no ray leaves the cover there"
    NO_POINT = "its ray does not reach the plane"
    NOWHERE = "its rays do not meet in front of the camera"


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredPoints:
    """The coordinates of N points in one frame, with their errors."""

    points: Array
    """(N, 3) m; NaN where the reason is not MEASURED."""
    noise: Array
    """(N, 3, 3) m^2: covariance from the noise of each point's pixels."""
    shared: Array
    """(N, 3, Q) m: changes of the points, one column for each of Q independent errors of unit
    variance that the points share.
    """
    gap_px: Array
    """(N,): root mean square angle between a triangulated point and its rays, in px of the mean
    focal length; 0 on a plane.
    """
    reasons: tuple[UnmeasuredReason, ...]
    """N reasons, one for each point."""

    @property
    def sigma(self) -> Array:
        """The (N, 3) m standard deviations of x, y and z."""
        return np.asarray(np.sqrt(np.einsum("nii->ni", self.noise) + (self.shared**2).sum(-1)))

    def distance(self, first: int, second: int) -> tuple[float, float]:
        """Return the distance in m between the points of two indices, and its sigma. Errors that
        move both points equally do not count.
        """
        first, second = indices((first, second), 2, len(self.points), "the pair of points").tolist()
        offset = self.points[second] - self.points[first]
        length = float(np.linalg.norm(offset))
        direction = offset / length if length else np.full(3, 3**-0.5)
        variance = (
            direction @ (self.noise[first] + self.noise[second]) @ direction
            + ((direction @ (self.shared[second] - self.shared[first])) ** 2).sum()
        )
        return length, float(np.sqrt(variance))


class Measurer:
    """Measures points and board poses with one calibrated camera."""

    def __init__(self, calibration: CalibrationSource, noise_px: float | None = None) -> None:
        """
        Args:
            calibration: the camera's calibration, or the path of its file or folder.
            noise_px: standard deviation per axis of the pixels that will be measured; by default
                that of the calibration's corners.
        """
        calibration = Calibration.of(calibration)
        self.calibration = calibration
        corner_noise = calibration.noise_px
        if noise_px is not None:
            self.noise_px = real_number(noise_px, "noise_px")
        elif corner_noise is not None:
            self.noise_px = corner_noise / 2**0.5
        else:
            raise InputError(
                "the calibration has too few corners to tell their noise: give noise_px, the"
                " standard deviation of a pixel's coordinate."
            )
        self._corner_noise = self.noise_px if corner_noise is None else corner_noise / 2**0.5
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
        """Return the pose of the board in a view: the one of least reprojection error through the
        calibrated camera.

        Raises:
            NotEnoughDataError: the visible corners do not determine a pose.
        """
        view = self._check_view(view)
        usable, unusable = split_usable_views((view,), self.calibration.board)
        path, values = self.calibration.model()
        observations = Observations.of(usable, self.calibration.board)
        start = pinhole_poses(path, values, observations)
        if unusable or not bool(torch.isfinite(start).all()):
            reason = unusable[0].reason if unusable else "no board pose explains its corners"
            raise NotEnoughDataError(
                f"{view.name}: {reason}: take a picture that shows the whole board."
            )
        with single_thread():
            poses, _ = refit_poses(path, values, observations, start)
            visible = observations.select_rows(reach_board(path, values, observations, poses))
            weights = pixel_weights(path, values, visible, poses, self._corner_noise)
            (landing,) = make_residual_blocks(path, Parameters.none(values), visible, weights)
            by_pose = landing.linearise(values, poses).jacobian_block.flatten(0, 1).numpy()
        try:
            noise = np.linalg.cholesky(np.linalg.inv(by_pose.T @ by_pose))
        except np.linalg.LinAlgError:
            raise NotEnoughDataError(
                f"{view.name}: no board pose explains its corners: take a picture that shows the"
                " whole board."
            ) from None
        pose, pixels = poses[0].numpy(), visible.pixels.numpy()
        repeated_pose = np.broadcast_to(pose, (len(pixels), 6))
        frames = self._ray_frames(pixels)
        by_line = central_differences(
            lambda lines: intersect(*self._to_rays(lines, frames), repeated_pose),
            self._to_lines(pixels, frames),
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
    ) -> MeasuredPoints:
        """Return the points where the rays of pixels meet planes, in the camera frame.

        Args:
            pixels: (N, 2)
            planes: V poses, whose x-y planes are used.
            plane: (N,) the index of each pixel's plane.
        """
        pixels, excluded = self._clip_to_picture(pixel_rows(pixels))
        plane_indices = indices(plane, len(pixels), len(planes), "plane")
        poses = _stack_poses(planes)[plane_indices]
        frames = self._ray_frames(pixels)
        lines = self._to_lines(pixels, frames)
        points = intersect(*self._to_rays(lines, frames), poses)
        by_line = central_differences(
            lambda varied: intersect(*self._to_rays(varied, frames), poses), lines, LINE_STEPS
        )
        by_pose = central_differences(
            lambda varied: intersect(*self._to_rays(lines, frames), varied), poses, POSE_STEPS
        )
        shared = self._shared_errors(
            planes, plane_indices, by_pose, by_line @ self._errors(pixels, frames)
        )
        return _measured_points(
            points,
            noise=self._noise_covariance(by_line, pixels, frames),
            shared=shared,
            gap_px=np.zeros(len(points)),
            excluded=excluded,
            without_ray=_without_ray(lines),
            unreached=UnmeasuredReason.NO_POINT,
        )

    def triangulate(
        self, pixels: Array, boards: Sequence[BoardPose], board: Sequence[int], point: Sequence[int]
    ) -> MeasuredPoints:
        """Return the N points that are nearest to their rays from several views, in the frame of
        the board, which is static in all of them.

        Args:
            pixels: (M, 2)
            boards: V poses of the board, one for each view.
            board: (M,) the index of each pixel's view.
            point: (M,) the index of the point that each pixel shows, from 0 to N - 1.
        """
        pixels, excluded = self._clip_to_picture(pixel_rows(pixels))
        board_indices = indices(board, len(pixels), len(boards), "board")
        point_indices = indices(point, len(pixels), len(pixels), "point")
        groups = _rows_by_point(point_indices)
        if not all(len(rows) for rows in groups):
            raise InputError("point leaves out a number: count the points from 0 on.")
        poses = _stack_poses(boards)[board_indices]
        frames = self._ray_frames(pixels)
        lines = self._to_lines(pixels, frames)
        errors = self._errors(pixels, frames)
        if not groups:
            return self.on_planes(pixels, boards, board_indices.tolist())
        results = [
            self._triangulate_point(
                rows, pixels, poses, frames, lines, errors, boards, board_indices
            )
            for rows in groups
        ]
        without_ray = _without_ray(lines)
        return _measured_points(
            np.concatenate([result.points for result in results]),
            noise=np.concatenate([result.noise for result in results]),
            shared=np.concatenate([result.shared for result in results]),
            gap_px=np.concatenate([result.gap_px for result in results]),
            excluded=np.array([excluded[rows].any() for rows in groups]),
            without_ray=np.array([without_ray[rows].any() for rows in groups]),
            unreached=UnmeasuredReason.NOWHERE,
        )

    def _triangulate_point(
        self,
        rows: Indices,
        pixels: Array,
        poses: Array,
        frames: Array,
        lines: Array,
        errors: Array,
        boards: Sequence[BoardPose],
        board_indices: Indices,
    ) -> MeasuredPoints:
        """Return the point of one group of pixels: the one nearest to the rays of these rows."""
        point_lines = lines[rows]
        point_poses = poses[rows]
        ray_frames = frames[rows]
        point, angles = triangulate(*self._to_rays(point_lines, ray_frames), point_poses)

        def by_line_of(row: int) -> Array:
            """Return the (1, 3, 4) derivatives of the point by the line of a row."""

            def move_line(line: Array) -> Array:
                varied = np.vstack([point_lines[:row], line, point_lines[row + 1 :]])
                return triangulate(*self._to_rays(varied, ray_frames), point_poses)[0][None]

            return central_differences(move_line, point_lines[row : row + 1], LINE_STEPS)

        def by_pose_of(row: int) -> Array:
            """Return the (1, 3, 6) derivatives of the point by the pose of a row."""

            def move_pose(pose: Array) -> Array:
                varied = np.vstack([point_poses[:row], pose, point_poses[row + 1 :]])
                return triangulate(*self._to_rays(point_lines, ray_frames), varied)[0][None]

            return central_differences(move_pose, point_poses[row : row + 1], POSE_STEPS)

        by_line = np.concatenate([by_line_of(row) for row in range(len(rows))])
        by_pose = np.concatenate([by_pose_of(row) for row in range(len(rows))])
        shared = self._shared_errors(boards, board_indices[rows], by_pose, by_line @ errors[rows])
        return MeasuredPoints(
            points=point[None],
            noise=self._noise_covariance(by_line, pixels[rows], ray_frames).sum(0, keepdims=True),
            shared=shared.sum(0, keepdims=True),
            gap_px=np.sqrt((angles**2).mean(keepdims=True)) * self._focal.mean(),
            reasons=(UnmeasuredReason.MEASURED,),
        )

    def _check_view(self, view: View) -> View:
        """Return the view without the corners that are outside the picture or have no weight."""
        count = self.calibration.board.count
        corners, excluded = self._clip_to_picture(pixel_rows(view.corners, "corners"))
        weight = numbers(view.weight, (count,), "weight")
        if len(corners) != count:
            raise InputError(
                f"corners are {len(corners)} where the board has {count}: give NaN for one that"
                " is not seen."
            )
        used = ~excluded & (weight > MIN_WEIGHT) & (weight < np.inf)
        return replace(
            view,
            corners=np.where(used[:, None], corners, np.nan),
            weight=np.where(used, np.minimum(weight, 1.0), 0.0),
        )

    def _clip_to_picture(self, pixels: Array) -> tuple[Array, Flags]:
        """Return (N, 2) px, in which pixels outside the picture are moved to its border, and an
        (N,) mask of these pixels. The picture ends half a pixel outside the centres of its border
        pixels. A pixel that is NaN counts as outside.
        """
        camera = self.calibration.camera
        last = np.array([camera.width, camera.height]) - 0.5
        excluded = np.asarray(~((pixels >= -0.5) & (pixels <= last)).all(-1))
        return (
            np.where(excluded[:, None], np.clip(np.nan_to_num(pixels), -0.5, last), pixels),
            excluded,
        )

    def _ray_frames(self, pixels: Array) -> Array:
        """Return (N, 3, 3) rotations from the camera frame to a frame along each pixel's ray. In
        that frame A and B are finite, however far the ray is from the camera's axis.
        """
        return frames_along(self.calibration.rays(pixels)[1])

    def _to_lines(self, pixels: Array, frames: Array) -> Array:
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

    def _to_rays(self, lines: Array, frames: Array) -> tuple[Array, Array]:
        """Return, in the camera frame, the (N, 3) m points where lines given by A and B cross the
        plane z = 0 of their frames, and their (N, 3) directions.
        """
        to_camera = frames.swapaxes(1, 2)
        origins = np.pad(lines[:, 2:] / self._focal, ((0, 0), (0, 1)))
        directions = np.pad(lines[:, :2] / self._focal, ((0, 0), (0, 1)), constant_values=1.0)
        return (
            np.einsum("nij,nj->ni", to_camera, origins),
            np.einsum("nij,nj->ni", to_camera, directions),
        )

    def _noise_covariance(self, by_line: Array, pixels: Array, frames: Array) -> Array:
        """Return the (N, 3, 3) m^2 covariance from the pixels' noise."""
        by_pixel = (
            self.noise_px
            * by_line
            @ central_differences(
                lambda varied: self._to_lines(varied, frames), pixels, (PIXEL_STEP, PIXEL_STEP)
            )
        )
        return np.asarray(by_pixel @ by_pixel.swapaxes(1, 2))

    def _shared_errors(
        self, planes: Sequence[BoardPose], plane_indices: Indices, by_pose: Array, by_rays: Array
    ) -> Array:
        """Return the (N, 3, S + 1 + 6 V) errors that points share: from the rays, directly and
        through the boards' poses, from the squares' side, then from the corners of each board.
        """
        by_rays = np.concatenate([by_rays, np.zeros((len(plane_indices), 3, 1))], -1)
        noise = np.zeros((len(plane_indices), 3, len(planes), 6))
        for row, plane in enumerate(plane_indices):
            noise[row, :, plane] = by_pose[row] @ planes[plane].noise
            if planes[plane].rays.size:
                by_rays[row] += by_pose[row] @ planes[plane].rays
        return np.concatenate([by_rays, noise.reshape(len(plane_indices), 3, -1)], -1)


def _measured_points(
    points: Array,
    noise: Array,
    shared: Array,
    gap_px: Array,
    excluded: Flags,
    without_ray: Flags,
    unreached: UnmeasuredReason,
) -> MeasuredPoints:
    """Return the points with their reasons, and NaN for every point that is not measured.

    Args:
        excluded: (N,) true where a pixel is outside the picture.
        without_ray: (N,) true where a pixel has no ray.
        unreached: the reason of the other points that are NaN.
    """
    reasons = np.select(
        [excluded, without_ray, np.isnan(points).any(-1)],
        [UnmeasuredReason.OUTSIDE, UnmeasuredReason.NO_RAY, unreached],
        UnmeasuredReason.MEASURED,
    ).tolist()
    refused = [bool(reason) for reason in reasons]
    for values in (points, noise, shared, gap_px):
        values[refused] = np.nan
    return MeasuredPoints(
        points=points,
        noise=noise,
        shared=shared,
        gap_px=gap_px,
        reasons=tuple(UnmeasuredReason(reason) for reason in reasons),
    )


def _without_ray(lines: Array) -> Flags:
    return np.asarray(np.isnan(lines).any(-1))


def _rows_by_point(point_indices: Indices) -> list[Indices]:
    return [
        np.flatnonzero(point_indices == n) for n in range(int(point_indices.max(initial=-1)) + 1)
    ]


def _check_pose(pose: Array) -> Array:
    checked = numbers(pose, (6,), "a pose")
    if not (np.abs(checked) < FARTHEST_M).all():
        raise InputError("a pose is not finite: give a rotation vector in rad and metres.")
    return checked


def _stack_poses(boards: Sequence[BoardPose]) -> Array:
    """Return the (V, 6) poses of boards; InputError if one is not finite."""
    return np.array([_check_pose(board.pose) for board in boards]).reshape(-1, 6)

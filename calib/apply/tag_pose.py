"""The pose of a tag from the rays of its corners, without a centre of projection: least squares in
the picture, with both minima of a small square.

A pixel's ray is a line, whose slopes x / z and y / z at depth Z are A + B / Z, wherever the ray
begins. So no centre of projection is needed. The misfit of a corner (X, Y, Z) is (X, Y) / Z - A -
B / Z in slopes. The derivative of A + B / Z by the pixel converts it to pixels to first order. The
slopes are affine in 1 / Z, so no ray is traced while a pose is estimated.

Start: with the depths of the previous round (infinity in the first one), the slopes are those of a
central camera. For a central camera, the two poses of a square that look most alike have a closed
form (T. Collins, A. Bartoli, Infinitesimal plane-based pose estimation, 2014; OpenCV's
SOLVEPNP_IPPE_SQUARE). A few rounds give a start for each of the two, and Levenberg-Marquardt steps
refine it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.optics.rays import FLATTEST
from calib.threads import single_thread

Array = NDArray[np.float64]

PIXEL_STEP = 0.05
"""px: the step of differences by a pixel's coordinates."""
ROUNDS = 4
"""The rounds for a start. Each multiplies the error of depth by the rays' distance from a common
centre over the depth, a hundredth.
"""
MAX_ITERATIONS = 50
MIN_STEP = 1e-9
"""rad, and relative to the distance: a step below this ends the iteration."""
DAMPING = 1e-6
MIN_SEPARATION = 1e-4
"""rad: two minima that are nearer to each other are the same pose."""
SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]) / 2
"""(4, 3) corners of a square of side 1: upper left, upper right, lower right, lower left; x to the
right, y down, z away from the viewer.
"""
UPWARD = np.diag([1.0, -1.0, -1.0])
"""The rotation from OpenCV's frame of the square: x to the right, y up, z out of the tag."""


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """The rays of N pixels, as slopes A + B / Z, in the camera frame or in a rotated one."""

    at_infinity: Array
    """(N, 2) A"""
    parallax: Array
    """(N, 2) m, B"""
    at_infinity_by_pixel: Array
    """(N, 2, 2) 1/px"""
    parallax_by_pixel: Array
    """(N, 2, 2) m/px"""

    @staticmethod
    def of(calibration: Calibration, pixels: Array, frames: Array | None = None) -> Lines:
        """Return the rays of (N, 2) px; NaN where no ray leaves the cover, or the ray does not go
        forward in its frame.

        Args:
            frames: (N, 3, 3) rotations from the camera frame to the frame of each pixel; None for
                the camera frame.
        """
        steps = PIXEL_STEP * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        with single_thread():
            origins, directions = calibration.rays((pixels + steps[:, None]).reshape(-1, 2))
        if frames is not None:
            turns = np.tile(frames, (len(steps), 1, 1))
            origins = np.einsum("nij,nj->ni", turns, origins)
            directions = np.einsum("nij,nj->ni", turns, directions)
        slopes = directions[:, :2] / np.where(
            directions[:, 2:] > FLATTEST, directions[:, 2:], np.nan
        )
        lines = np.stack([slopes, origins[:, :2] - slopes * origins[:, 2:]]).reshape(2, 5, -1, 2)
        by_pixel = np.stack([lines[:, 1] - lines[:, 2], lines[:, 3] - lines[:, 4]], -1) / (
            2 * PIXEL_STEP
        )
        return Lines(lines[0, 0], lines[1, 0], by_pixel[0], by_pixel[1])

    @property
    def is_complete(self) -> bool:
        """True if each pixel and its neighbours have a ray."""
        return bool(
            np.isfinite(self.at_infinity_by_pixel).all() and np.isfinite(self.at_infinity).all()
        )

    def select(self, rows: NDArray[np.signedinteger] | slice) -> Lines:
        """Return the rays of some rows."""
        return Lines(
            self.at_infinity[rows],
            self.parallax[rows],
            self.at_infinity_by_pixel[rows],
            self.parallax_by_pixel[rows],
        )


@dataclass(frozen=True, slots=True, eq=False)
class TagMisfit:
    """The distances of a square's four corners from their rays, and their derivatives."""

    px: Array
    """(8,) x and y of each corner, measured less expected, to first order."""
    by_pose: Array
    """(8, 6) derivatives by a small turn about the camera's axes, rad, and a shift, m."""
    by_line: Array
    """(4, 2, 4) derivatives by A and B of the corner's ray."""
    by_size: Array
    """(8,) derivatives by the side's relative length."""


def measure_misfit(lines: Lines, side: float, turn: Array, shift: Array) -> TagMisfit:
    """Return the misfit of four rays and a square.

    Args:
        lines: the rays of the four corners.
        side: m
        turn: (3, 3) rotation of T_camera_tag.
        shift: (3,) m translation of T_camera_tag.
    """
    arm = side * SQUARE @ turn.T
    points = arm + shift
    inverse = 1 / points[:, 2]
    offset = points[:, :2] - lines.parallax
    slope_error = lines.at_infinity - offset * inverse[:, None]  # (4, 2)
    to_pixels = np.linalg.inv(
        lines.at_infinity_by_pixel + lines.parallax_by_pixel * inverse[:, None, None]
    )
    px = (to_pixels @ slope_error[..., None])[..., 0]
    by_point = np.zeros((4, 2, 3))
    by_point[:, 0, 0] = by_point[:, 1, 1] = -inverse
    by_point[:, :, 2] = offset * inverse[:, None] ** 2
    by_point[:, :, 2] += (lines.parallax_by_pixel @ px[..., None])[..., 0] * inverse[
        :, None
    ] ** 2  # the pixels' own scale
    by_point = to_pixels @ by_point
    motion = np.concatenate(
        [-_cross_matrices(arm), np.broadcast_to(np.eye(3), (4, 3, 3))], -1
    )  # (4, 3, 6)
    by_line = np.concatenate([to_pixels, to_pixels * inverse[:, None, None]], -1)
    return TagMisfit(
        px.ravel(), (by_point @ motion).reshape(8, 6), by_line, (by_point @ arm[..., None]).ravel()
    )


def starts(lines: Lines, side: float) -> list[tuple[Array, Array]]:
    """Return starts for T_camera_tag, (3, 3) and (3,) m, of a square in front of the camera: two as
    a rule, from the slopes of its corners at approximate depths.
    """
    pose_starts = []
    for index in (0, 1):
        inverse, pose = np.zeros(4), None
        for _ in range(ROUNDS):
            slopes = lines.at_infinity + lines.parallax * inverse[:, None]
            pose = _central_pose(slopes, side, index)
            if pose is None:
                break
            depth = (side * SQUARE @ pose[0].T + pose[1])[:, 2]
            if not (depth > 0).all():
                pose = None
                break
            inverse = 1 / depth
        if pose is not None:
            pose_starts.append(pose)
    return pose_starts


def refine_pose(
    lines: Lines, side: float, whiten: Array, turn: Array, shift: Array
) -> tuple[Array, Array, float]:
    """Return the nearest minimum, T_camera_tag, and its chi^2, which is infinite if the square is
    not in front of the camera.

    Args:
        whiten: (8, 8) W with W^T W the inverse of the corners' covariance.
    """
    damping = DAMPING
    current, cost = _evaluate(lines, side, whiten, turn, shift)
    for _ in range(MAX_ITERATIONS):
        if not np.isfinite(cost):
            return turn, shift, np.inf
        jacobian = whiten @ current.by_pose
        normal = jacobian.T @ jacobian
        step = -np.linalg.solve(
            normal + damping * np.diag(normal.diagonal()), jacobian.T @ (whiten @ current.px)
        )
        moved_pose = cv2.Rodrigues(step[:3])[0] @ turn, shift + step[3:]
        candidate, new_cost = _evaluate(lines, side, whiten, *moved_pose)
        if new_cost <= cost:
            (turn, shift), current, cost, damping = moved_pose, candidate, new_cost, damping / 10
        else:
            damping *= 10
        if np.abs(step[:3]).max() < MIN_STEP and np.linalg.norm(
            step[3:]
        ) < MIN_STEP * np.linalg.norm(shift):
            break
    return turn, shift, cost


def poses(lines: Lines, side: float, whiten: Array) -> list[tuple[Array, Array, float]]:
    """Return the minima, the least chi^2 first: T_camera_tag, (3, 3) and (3,) m, and chi^2."""
    minima: list[tuple[Array, Array, float]] = []
    for start in starts(lines, side):
        turn, shift, cost = refine_pose(lines, side, whiten, *start)
        is_duplicate = any(
            np.linalg.norm(cv2.Rodrigues(turn @ minimum[0].T)[0]) < MIN_SEPARATION
            for minimum in minima
        )
        if np.isfinite(cost) and turn[:, 2] @ shift > 0 and not is_duplicate:
            minima.append((turn, shift, cost))
    return sorted(minima, key=lambda minimum: minimum[2])


def _evaluate(
    lines: Lines, side: float, whiten: Array, turn: Array, shift: Array
) -> tuple[TagMisfit, float]:
    """Return the misfit and chi^2, which is infinite for a square behind the camera."""
    current = measure_misfit(lines, side, turn, shift)
    ahead = bool(((side * SQUARE @ turn.T + shift)[:, 2] > 0).all())
    return current, float(((whiten @ current.px) ** 2).sum()) if ahead else np.inf


def _central_pose(slopes: Array, side: float, index: int) -> tuple[Array, Array] | None:
    """Return one of the two poses of a square whose corners have the slopes (4, 2) from a central
    camera; None if there is none.
    """
    try:
        count, turns, shifts, _ = cv2.solvePnPGeneric(
            side * SQUARE @ UPWARD, slopes[:, None], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
    except cv2.error:
        return None
    if count <= index:
        return None
    turn = np.asarray(cv2.Rodrigues(turns[index])[0] @ UPWARD, np.float64)
    shift = np.asarray(shifts[index], np.float64).ravel()
    return (turn, shift) if np.isfinite(turn).all() and np.isfinite(shift).all() else None


def _cross_matrices(vectors: Array) -> Array:
    """Return the (N, 3, 3) matrices of the cross products with (N, 3) vectors, v x."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)

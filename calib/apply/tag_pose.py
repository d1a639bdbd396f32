"""The pose of a tag from the rays of its corners: non-central, least squares in the picture, both
minima of a small square.

A pixel's ray is the line whose undistorted pixel at depth Z is A + B / Z, wherever it begins; so no
centre of projection is needed. In slopes, that is x / z and y / z of what it sees there, the misfit
of a corner X is (X, Y) / Z - A - B / Z, and turned to pixels to first order by the derivative of A
+ B / Z by the pixel. That is affine in 1 / Z, so no ray is traced while poses are sought.

Start: at the depths that the last round gave, the first time at infinity, the slopes are those of a
    central camera, and of a square seen
by one the two poses that look most alike are known in closed form (T. Collins, A. Bartoli,
Infinitesimal plane-based pose estimation, 2014; OpenCV's SOLVEPNP_IPPE_SQUARE). Some rounds of this
make each a start of its own, which Levenberg's and Marquardt's steps refine.
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
"""px, of differences."""
ROUNDS = 4
"""Of starts: each leaves of an error of depth what rays miss a common centre by over the distance,
a hundredth.
"""
STEPS = 50
SETTLED = 1e-9
"""rad, and of the distance."""
DAMPING = 1e-6
SAME = 1e-4
"""rad: two starts that end nearer to each other are one pose."""
SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]) / 2
"""(4, 3) sides: upper left, upper right, lower right, lower left; x to the right, y down, z away
from who looks at it.
"""
UPWARD = np.diag([1.0, -1.0, -1.0])
"""From a frame with x to the right, y up and z out of the tag, which is OpenCV's."""


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
        both = np.stack([slopes, origins[:, :2] - slopes * origins[:, 2:]]).reshape(2, 5, -1, 2)
        by_pixel = np.stack([both[:, 1] - both[:, 2], both[:, 3] - both[:, 4]], -1) / (
            2 * PIXEL_STEP
        )
        return Lines(both[0, 0], both[1, 0], by_pixel[0], by_pixel[1])

    @property
    def seen(self) -> bool:
        """Whether each has a ray, and so have the pixels beside it."""
        return bool(
            np.isfinite(self.at_infinity_by_pixel).all() and np.isfinite(self.at_infinity).all()
        )

    def some(self, rows: NDArray[np.signedinteger] | slice) -> Lines:
        return Lines(
            self.at_infinity[rows],
            self.parallax[rows],
            self.at_infinity_by_pixel[rows],
            self.parallax_by_pixel[rows],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Misfit:
    """How far a square's four corners are from their rays."""

    px: Array
    """(8,) x and y of each corner, seen less expected, to first order."""
    by_pose: Array
    """(8, 6) by a small turn about the camera's axes, rad, and a shift, m."""
    by_line: Array
    """(4, 2, 4) by A and B of the own ray."""
    by_size: Array
    """(8,) by the side, as a part of it."""


def misfit(lines: Lines, side: float, turn: Array, shift: Array) -> Misfit:
    """Of four rays and the square at T_camera_tag, (3, 3) and (3,) m."""
    arm = side * SQUARE @ turn.T
    points = arm + shift
    inverse = 1 / points[:, 2]
    apart = points[:, :2] - lines.parallax
    off = lines.at_infinity - apart * inverse[:, None]  # (4, 2)
    to_pixels = np.linalg.inv(
        lines.at_infinity_by_pixel + lines.parallax_by_pixel * inverse[:, None, None]
    )
    px = (to_pixels @ off[..., None])[..., 0]
    by_point = np.zeros((4, 2, 3))
    by_point[:, 0, 0] = by_point[:, 1, 1] = -inverse
    by_point[:, :, 2] = apart * inverse[:, None] ** 2
    by_point[:, :, 2] += (lines.parallax_by_pixel @ px[..., None])[..., 0] * inverse[
        :, None
    ] ** 2  # the pixels' own scale
    by_point = to_pixels @ by_point
    moved = np.concatenate([-_cross(arm), np.broadcast_to(np.eye(3), (4, 3, 3))], -1)  # (4, 3, 6)
    by_line = np.concatenate([to_pixels, to_pixels * inverse[:, None, None]], -1)
    return Misfit(
        px.ravel(), (by_point @ moved).reshape(8, 6), by_line, (by_point @ arm[..., None]).ravel()
    )


def starts(lines: Lines, side: float) -> list[tuple[Array, Array]]:
    """T_camera_tag, (3, 3) and (3,) m, of a square before the camera: two as a rule, by the rays of
    its corners at rough depths.
    """
    found = []
    for which in (0, 1):
        inverse, pose = np.zeros(4), None
        for _ in range(ROUNDS):
            slopes = lines.at_infinity + lines.parallax * inverse[:, None]
            pose = _central(slopes, side, which)
            if pose is None:
                break
            depth = (side * SQUARE @ pose[0].T + pose[1])[:, 2]
            if not (depth > 0).all():
                pose = None
                break
            inverse = 1 / depth
        if pose is not None:
            found.append(pose)
    return found


def refine(
    lines: Lines, side: float, whiten: Array, turn: Array, shift: Array
) -> tuple[Array, Array, float]:
    """The nearest minimum: T_camera_tag and its chi^2; infinite where it leaves the front of the
    camera.

    Args:
        whiten: (8, 8) W with W^T W the inverse of the corners' covariance.
    """
    damping = DAMPING
    here, cost = _at(lines, side, whiten, turn, shift)
    for _ in range(STEPS):
        if not np.isfinite(cost):
            return turn, shift, np.inf
        jacobian = whiten @ here.by_pose
        normal = jacobian.T @ jacobian
        step = -np.linalg.solve(
            normal + damping * np.diag(normal.diagonal()), jacobian.T @ (whiten @ here.px)
        )
        tried = cv2.Rodrigues(step[:3])[0] @ turn, shift + step[3:]
        there, new_cost = _at(lines, side, whiten, *tried)
        if new_cost <= cost:
            (turn, shift), here, cost, damping = tried, there, new_cost, damping / 10
        else:
            damping *= 10
        if np.abs(step[:3]).max() < SETTLED and np.linalg.norm(step[3:]) < SETTLED * np.linalg.norm(
            shift
        ):
            break
    return turn, shift, cost


def poses(lines: Lines, side: float, whiten: Array) -> list[tuple[Array, Array, float]]:
    """All minima that are found, the most probable first: T_camera_tag, (3, 3) and (3,) m, and
    chi^2.
    """
    found: list[tuple[Array, Array, float]] = []
    for start in starts(lines, side):
        turn, shift, cost = refine(lines, side, whiten, *start)
        alike = any(np.linalg.norm(cv2.Rodrigues(turn @ other[0].T)[0]) < SAME for other in found)
        if np.isfinite(cost) and turn[:, 2] @ shift > 0 and not alike:
            found.append((turn, shift, cost))
    return sorted(found, key=lambda one: one[2])


def _at(
    lines: Lines, side: float, whiten: Array, turn: Array, shift: Array
) -> tuple[Misfit, float]:
    here = misfit(lines, side, turn, shift)
    ahead = bool(((side * SQUARE @ turn.T + shift)[:, 2] > 0).all())
    return here, float(((whiten @ here.px) ** 2).sum()) if ahead else np.inf


def _central(slopes: Array, side: float, which: int) -> tuple[Array, Array] | None:
    """One of the two poses of a square whose corners are seen along these slopes, (4, 2)."""
    try:
        found, turns, shifts, _ = cv2.solvePnPGeneric(
            side * SQUARE @ UPWARD, slopes[:, None], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
    except cv2.error:
        return None
    if found <= which:
        return None
    turn, shift = (
        np.asarray(cv2.Rodrigues(turns[which])[0] @ UPWARD, np.float64),
        np.asarray(shifts[which], np.float64).ravel(),
    )
    return (turn, shift) if np.isfinite(turn).all() and np.isfinite(shift).all() else None


def _cross(vectors: Array) -> Array:
    """(N, 3) to the (N, 3, 3) matrices [v] of v x."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)

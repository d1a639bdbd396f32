"""A camera with OpenCV's lens that was fitted to views."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View
from calib.session.board import Board
from calib.session.camera import Intrinsics
from calib.session.schema import Number

MAX_ANGLE = np.radians(80)
"""The angle from the axis to which a lens is followed for a pole."""
ANGLES = 400
LEAST_DENOMINATOR = 0.05
"""Where a lens magnifies its corners twenty times, a pole is near."""


@dataclass(frozen=True, slots=True)
class OpenCVFit:
    """A camera with OpenCV's lens, fitted to views."""

    camera: NDArray[np.float64]
    """(3, 3) camera matrix, px."""
    coefficients: NDArray[np.float64]
    """(count,) lens coefficients, in OpenCV's order."""
    per_view: NDArray[np.float64]
    """(V,) root mean square error of each view, px."""
    poses: NDArray[np.float64]
    """(V, 6) T_camera_board: rotation vector (rad) and translation (m)."""
    rms: float
    """Root mean square error, px."""

    @property
    def focal(self) -> float:
        """Return the focal length along x, px."""
        return float(self.camera[0, 0])

    @property
    def parameters(self) -> NDArray[np.float64]:
        """Return the (4 + count,) parameters: fx, fy, cx, cy and the coefficients."""
        return np.array([*self.camera[[0, 1, 0, 1], [0, 1, 2, 2]], *self.coefficients])

    @property
    def has_pole(self) -> bool:
        """True if the radial terms have a pole inside the picture."""
        return has_pole(self.camera, self.coefficients)

    def intrinsics(self, covariance: NDArray[np.float64]) -> Intrinsics:
        """Return the intrinsics with standard deviations and correlations from the covariance of
        `parameters`.
        """
        sigmas = np.sqrt(covariance.diagonal())
        correlation = covariance / np.outer(sigmas, sigmas)
        numbers = [
            Number(float(value), float(sigma))
            for value, sigma in zip(self.parameters, sigmas, strict=True)
        ]
        fx, fy, cx, cy = numbers[:4]
        return Intrinsics(
            fx,
            fy,
            cx,
            cy,
            tuple(numbers[4:]),
            tuple(tuple(row[:i].tolist()) for i, row in enumerate(correlation) if i),
        )

    def errors(self, views: Sequence[View], board: Board) -> NDArray[np.float64]:
        """Return the (V,) root mean square errors, px, of views that it was not fitted to, with
        their poses refitted; NaN for a view without a pose.
        """
        return np.array([self._error(view, board) for view in views])

    def _error(self, view: View, board: Board) -> float:
        points = board.points_in_space()[view.seen]
        pixels = view.corners[view.seen]
        try:
            has_pose, rotvec, translation = cv2.solvePnP(
                points, pixels, self.camera, self.coefficients
            )
        except cv2.error:  # the corners determine no pose
            has_pose = False
        if not has_pose:
            return float("nan")
        projected, _ = cv2.projectPoints(
            points, rotvec, translation, self.camera, self.coefficients
        )
        return float(np.sqrt(((projected.reshape(-1, 2) - pixels) ** 2).sum(-1).mean()))


def has_pole(camera: NDArray[np.float64], coefficients: NDArray[np.float64]) -> bool:
    """Return True if the rational radial terms of OpenCV's lens have a pole, or nearly one, between
    the axis and the picture's corner. The picture's middle is taken to be the principal point.

    Args:
        camera: (3, 3) camera matrix, px.
        coefficients: (count,) lens coefficients, in OpenCV's order.
    """
    corner = float(np.hypot(*(camera[:2, 2] / camera.diagonal()[:2])))
    k1, k2, _, _, k3, k4, k5, k6 = np.pad(coefficients[:8], (0, max(0, 8 - len(coefficients))))
    radius = np.tan(np.linspace(0.0, MAX_ANGLE, ANGLES))
    square = radius**2
    denominator = 1 + square * (k4 + square * (k5 + square * k6))
    with np.errstate(divide="ignore"):
        reached = radius * (1 + square * (k1 + square * (k2 + square * k3))) / denominator
    crossings = np.flatnonzero(reached >= corner)
    in_picture = denominator[: crossings[0]] if len(crossings) else denominator
    return bool(in_picture.min() < LEAST_DENOMINATOR)

"""How well a calibration without a cover knows its intrinsics, all together: their covariance, the
boards' poses unknown.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.session.board import Board

Array = NDArray[np.float64]

LEAST_TOLD = 1e-6
"""Of the direction that the views tell best, columns of length one: what they tell less is taken to
be told so much, so that the covariance can be inverted in double precision. Eight coefficients for
a lens that needs two come down to 3e-7.
"""


def intrinsics_covariance(
    views: Sequence[View], board: Board, matrix: Array, coefficients: Array, poses: Array
) -> Array:
    """The covariance at the least-squares fit, with the noise that its residual shows.

    Args:
        views: that were fitted.
        matrix: (3, 3) px, of the camera.
        coefficients: (n,) of the lens, in OpenCV's order.
        poses: (V, 6) of the board: rotation vector (rad) and translation (m).

    Returns:
        (4 + n, 4 + n) of fx, fy, cx, cy and the coefficients.

    Raises:
        NotEnoughDataError: the views leave one of them open.
    """
    count = 4 + len(coefficients)
    points = np.column_stack([board.points(), np.zeros(board.count)])
    jacobian, square = [], 0.0
    for view, pose in zip(views, poses, strict=True):
        pixels, derivatives = cv2.projectPoints(
            points[view.seen], pose[:3], pose[3:], matrix, coefficients
        )
        square += float(((pixels.reshape(-1, 2) - view.corners[view.seen]) ** 2).sum())
        by_all = np.asarray(derivatives, np.float64)
        by_pose, _ = np.linalg.qr(by_all[:, :6])
        shared = by_all[:, 6 : 6 + count]
        jacobian.append(shared - by_pose @ (by_pose.T @ shared))
    rows = np.concatenate(jacobian)  # (2M, 4 + n)
    lengths = np.linalg.norm(rows, axis=0)
    left = freedom(views, poses, len(coefficients))
    if left <= 0 or not np.isfinite(rows).all() or not lengths.all():
        raise NotEnoughDataError(
            "The views without the cover leave some of the intrinsics open: "
            "take more pictures of the board, tilted in different directions."
        )
    _, told, directions = np.linalg.svd(rows / lengths, full_matrices=False)
    root = directions.T / np.maximum(told, LEAST_TOLD * told[0]) / lengths[:, None]
    return np.asarray(square / left * root @ root.T)


def freedom(views: Sequence[View], poses: Array, coefficients: int) -> int:
    """Residuals less parameters of a camera with so many lens coefficients."""
    return 2 * sum(view.count for view in views) - poses.size - 4 - coefficients


def widened_along(direction: Array, sigma: float, covariance: Array) -> Array:
    """The covariance of parameters that change along `direction`, (n,) with 1 at the first, as far
    as `sigma` of the first says.
    """
    return np.asarray(covariance + (sigma**2 - covariance[0, 0]) * np.outer(direction, direction))

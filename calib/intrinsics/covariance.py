"""The covariance of the intrinsics of a calibration without a cover, with the poses of the boards
marginalised.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.estimation.orthogonal_projection import project_out
from calib.session.board import Board

Array = NDArray[np.float64]

MIN_SINGULAR_RATIO = 1e-6
"""Lower limit of the singular values of the Jacobian with normalised columns, relative to the
largest. Smaller ones are raised to it, so that the covariance can be inverted in double precision.
Eight coefficients for a lens that needs two come down to 3e-7.
"""


def intrinsics_covariance(
    views: Sequence[View], board: Board, matrix: Array, coefficients: Array, poses: Array
) -> Array:
    """Return the covariance at the least-squares fit, with the noise variance of its residual.

    Args:
        views: the fitted views.
        matrix: (3, 3) px, the camera matrix.
        coefficients: (n,) lens coefficients, in OpenCV's order.
        poses: (V, 6) poses of the board: rotation vector (rad) and translation (m).

    Returns:
        (4 + n, 4 + n) covariance of fx, fy, cx, cy and the coefficients.

    Raises:
        NotEnoughDataError: the views do not determine one of them.
    """
    count = 4 + len(coefficients)
    points = board.points_in_space()
    jacobian = []
    squares = 0.0
    for view, pose in zip(views, poses, strict=True):
        pixels, derivatives = cv2.projectPoints(
            points[view.seen], pose[:3], pose[3:], matrix, coefficients
        )
        squares += float(((pixels.reshape(-1, 2) - view.corners[view.seen]) ** 2).sum())
        full_jacobian = np.asarray(derivatives, np.float64)
        jacobian.append(project_out(full_jacobian[:, :6], full_jacobian[:, 6 : 6 + count]))
    rows = np.concatenate(jacobian)  # (2M, 4 + n)
    lengths = np.linalg.norm(rows, axis=0)
    degrees = freedom(views, poses, len(coefficients))
    if degrees <= 0 or not np.isfinite(rows).all() or not lengths.all():
        raise NotEnoughDataError(
            "The views without the cover do not determine all intrinsics: "
            "take more pictures of the board, tilted in different directions."
        )
    _, singular_values, directions = np.linalg.svd(rows / lengths, full_matrices=False)
    raised = np.maximum(singular_values, MIN_SINGULAR_RATIO * singular_values[0])
    root = directions.T / raised / lengths[:, None]
    return np.asarray(squares / degrees * root @ root.T)


def freedom(views: Sequence[View], poses: Array, coefficients: int) -> int:
    """Return the degrees of freedom: residuals less parameters, for `coefficients` lens
    coefficients.
    """
    return 2 * sum(view.count for view in views) - poses.size - 4 - coefficients


def widen_along(direction: Array, sigma: float, covariance: Array) -> Array:
    """Return the covariance, widened along `direction` until the first parameter has `sigma`.

    Args:
        direction: (n,), 1 at the first parameter.
        sigma: standard deviation of the first parameter.
        covariance: (n, n).
    """
    return np.asarray(covariance + (sigma**2 - covariance[0, 0]) * np.outer(direction, direction))

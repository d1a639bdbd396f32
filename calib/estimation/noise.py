"""Estimates of the noise of detected corners, from the part of the residuals that no smooth effect
can explain.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.estimation.robust import SIGMA
from calib.session.board import Board

MIN_DIFFERENCES = 20
MAX_DEGREE = 5
"""The highest degree of the polynomial over a board that is removed before the noise of a single
view is estimated.
"""
MIN_NOISE = 1e-3
"""px: no corner is measured better. A smaller error is the rounding of computed corners, which must
not count as an observation.
"""
COPY_TOLERANCE = 1e-6
"""px: two pictures whose residuals differ by less show the same corners."""
SPREAD = 1.5
"""The relative standard deviation of a single view's noise, times the root of the number of its
second differences: measured, 1.3 to 1.6 for boards of 4x3 to 20x15, complete or in part. The
polynomial absorbs 3 % of the differences themselves.
"""


def short_scale_noise(residuals: NDArray[np.float64], board: Board) -> float | None:
    """Return the noise floor of a fit, from its own residuals.

    The offset of a corner from the line through its two neighbours in a row or a column cancels
    everything that varies slowly over the board. With neighbours at equal distances, independent
    noise of variance s^2 gives this offset the variance 1.5 s^2. The median absolute value is
    robust against single bad corners.

    Args:
        residuals: (V, corners of the board, 2) px, NaN where not detected.

    Returns:
        px, the root mean square of the two-dimensional error from noise alone; None with too few
        corners.
    """
    return _robust_noise(_second_differences(residuals, board).ravel())


STATED_NOISE_RATIO = 1.25
"""Error over the noise that a target's points state, up to which the error is their noise.

Decoded points state it to a quarter (docs/screen-target.md). Their systematic errors, up to 0.002
px, differ from view to view, and are significant among so many points.
"""


def is_stated_noise(board: Board, rms_px: float, noise_px: float | None) -> bool:
    """True for a target of points if the error, px, is no more than the noise that they state."""
    return not board.has_grid and noise_px is not None and rms_px <= STATED_NOISE_RATIO * noise_px


def stated_noise(views: Sequence[View]) -> float | None:
    """Return the noise that the covariances of points state, px, as `short_scale_noise` does from
    residuals; None if a view has none.
    """
    squares = [
        np.trace(view.covariance[view.seen], axis1=1, axis2=2)
        for view in views
        if view.covariance is not None
    ]
    if len(squares) < len(views) or not squares:
        return None
    return float(np.sqrt(np.concatenate(squares).mean()))


def corner_noise(residuals: Tensor, views: Sequence[View], board: Board) -> float | None:
    """Return the noise of the corners, px: from a fit's (M, 2) px residuals, one row for each seen
    corner, or for points as their covariances state it; None if neither tells.
    """
    if not board.has_grid:
        return stated_noise(views)
    return short_scale_noise(on_board_grid(residuals, views), board)


def noise_of_views(
    residuals: NDArray[np.float64], board: Board
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the same for each view by itself, (V,) px, NaN with too few corners, and its relative
    standard deviation, (V,).

    First, a polynomial of the board's coordinates is removed, of the highest degree that leaves two
    thirds of a view's degrees of freedom: a missing effect can be a hundred times the noise in some
    views, and curved enough to contribute to the differences.
    """
    if board.has_grid:
        residuals = np.stack([_without_polynomial(view, board) for view in residuals])
    views = _second_differences(residuals, board)
    noise = np.array([_robust_noise(view) for view in views], dtype=np.float64)  # NaN for None
    return noise, SPREAD / np.sqrt(np.maximum(np.isfinite(views).sum(1), 1))


def _without_polynomial(residuals: NDArray[np.float64], board: Board) -> NDArray[np.float64]:
    """Return the (corners of the board, 2) px without their smooth part."""
    detected = np.isfinite(residuals).all(1)
    count = detected.sum()
    degree = next((d for d in range(MAX_DEGREE, 0, -1) if 3 * (d + 1) * (d + 2) / 2 <= count), 0)
    terms = _polynomial_terms(board, degree)
    remainder = residuals.copy()
    if detected.any():
        solution = np.linalg.lstsq(terms[detected], residuals[detected], rcond=None)[0]
        remainder[detected] -= terms[detected] @ solution
    return remainder


@lru_cache(maxsize=4)
def _polynomial_terms(board: Board, degree: int) -> NDArray[np.float64]:
    """Return the (corners of the board, n) terms of a polynomial of the board's coordinates."""
    x, y = (board.points() / board.half).T
    return np.stack([x**i * y**k for i in range(degree + 1) for k in range(degree + 1 - i)], 1)


def _second_differences(residuals: NDArray[np.float64], board: Board) -> NDArray[np.float64]:
    """Return the (V, differences) px second differences along rows and columns, per axis."""
    if not board.has_grid:
        return np.empty((len(residuals), 0))
    grid = residuals.reshape(-1, board.rows, board.columns, 2)
    places = board.points().reshape(board.rows, board.columns, 2)
    along_rows = _line_differences(grid, places[0, :, 0])
    along_columns = _line_differences(grid.swapaxes(1, 2), places[:, 0, 1])
    return np.concatenate(
        [along_rows.reshape(len(grid), -1), along_columns.reshape(len(grid), -1)], axis=1
    )


def _robust_noise(differences: NDArray[np.float64]) -> float | None:
    differences = differences[np.isfinite(differences)]
    if differences.size < MIN_DIFFERENCES:
        return None
    return float(2**0.5 * SIGMA * np.median(np.abs(differences)))


def _line_differences(
    lines: NDArray[np.float64], places: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the (V, lines, corners - 2, 2) offsets of (V, lines, corners, 2) corners from the line
    through their neighbours, scaled to the variance of the noise.
    """
    fraction = ((places[1:-1] - places[:-2]) / (places[2:] - places[:-2]))[:, None]
    offset = lines[:, :, 1:-1] - (1 - fraction) * lines[:, :, :-2] - fraction * lines[:, :, 2:]
    return np.asarray(offset / np.sqrt(1 + fraction**2 + (1 - fraction) ** 2))


def burst_noise(
    residuals: NDArray[np.float64], poses: Sequence[int] | NDArray[np.int64]
) -> float | None:
    """Return the noise from the differences between pictures of the same pose of the board.

    The pose of each picture was fitted, so a board that trembles in the hand contributes its motion
    blur only.

    Args:
        residuals: (V, corners of the board, 2) px, NaN where a corner was not detected.
        poses: (V,) integer labels, equal for the pictures of one burst.

    Returns:
        px, the root mean square of the two-dimensional noise; None if there are too few such
        pictures.
    """
    differences = []
    for pose in dict.fromkeys(np.asarray(poses).tolist()):
        burst = _distinct(residuals[[index for index, label in enumerate(poses) if label == pose]])
        pictures = len(burst)
        detected = np.isfinite(burst).all((0, 2))
        # The six parameters of each picture's pose take their share of the variance.
        free = 1 - 6 / max(7, 2 * int(detected.sum()))
        offset = burst[:, detected] - burst[:, detected].mean(0)
        differences.append(
            (offset / np.sqrt(free * (1 - 1 / pictures))).ravel() if pictures > 1 else np.empty(0)
        )
    offsets = np.concatenate(differences)
    if offsets.size < 20:
        return None
    return float(2**0.5 * SIGMA * np.median(np.abs(offsets)))


def _distinct(pictures: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (P, ...) residuals without copies of one picture, which differ by rounding alone."""
    rounded = np.nan_to_num(pictures.reshape(len(pictures), -1) / COPY_TOLERANCE, nan=np.inf)
    _, first = np.unique(rounded.round(), axis=0, return_index=True)
    return pictures[np.sort(first)]


def on_board_grid(errors: Tensor, views: Sequence[View]) -> NDArray[np.float64]:
    """Spread the (M, 2) px errors of the detected corners over (V, corners of the board, 2), NaN
    where a corner was not detected.
    """
    full = np.full((len(views), len(views[0].weight), 2), np.nan)
    full[np.array([view.seen for view in views])] = errors.numpy()
    return full

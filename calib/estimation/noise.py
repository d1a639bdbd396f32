"""The noise of the detected corners, from what no smooth effect can explain."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.estimation.robust import SIGMA
from calib.session.board import Board

FEWEST_BENDS = 20
HIGHEST = 5
"""Degree of what is smooth over a board, for a single view's noise."""
LEAST_NOISE = 1e-3
"""px: no corner is measured better. A smaller error is rounding, of corners that were computed, and
would make rounding an observation.
"""
COPY = 1e-6
"""px: residuals of two pictures that differ by less are of the same corners."""
SPREAD = 1.5
"""Standard deviation of a single view's noise over itself, times the root of the number of its
bends: measured, 1.3 to 1.6 for boards of 4x3 to 20x15, whole or in part. What the polynomial takes
of the bends themselves is 3 % of them.
"""


def short_scale_noise(residuals: NDArray[np.float64], board: Board) -> float:
    """The noise floor of a fit from its own residuals.

    What a corner is off the line through its two neighbours in a row or a column cancels what
    varies slowly over the board; with neighbours at equal distances, independent noise of variance
    s^2 gives that 1.5 s^2. The median absolute value keeps single bad corners out.

    Args:
        residuals: (V, corners of the board, 2) px, NaN where not seen.

    Returns:
        px, root mean square of the two-dimensional error that noise alone would leave; NaN with too
        few corners.
    """
    return _typical(_off_neighbours(residuals, board).ravel())


def noise_of_views(
    residuals: NDArray[np.float64], board: Board
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The same of each view by itself, (V,) px, NaN with too few corners, and its standard
    deviation over itself, (V,).

    A polynomial of the board's coordinates is taken out first, of as high a degree as leaves two
    thirds of a view's freedom: what a model lacks can be a hundred times the noise in some views,
    and bends enough there.
    """
    views = _off_neighbours(
        np.stack([_without_polynomial(view, board) for view in residuals]), board
    )
    noise = np.array([_typical(view) for view in views])
    return noise, SPREAD / np.sqrt(np.maximum(np.isfinite(views).sum(1), 1))


def _without_polynomial(residuals: NDArray[np.float64], board: Board) -> NDArray[np.float64]:
    """(corners of the board, 2) px without what is smooth."""
    seen = np.isfinite(residuals).all(1)
    degree = next((d for d in range(HIGHEST, 0, -1) if 3 * (d + 1) * (d + 2) / 2 <= seen.sum()), 0)
    x, y = (board.points() / board.half).T
    terms = np.stack([x**i * y**k for i in range(degree + 1) for k in range(degree + 1 - i)], 1)
    left = residuals.copy()
    if seen.any():
        left[seen] -= terms[seen] @ np.linalg.lstsq(terms[seen], residuals[seen], rcond=None)[0]
    return left


def _off_neighbours(residuals: NDArray[np.float64], board: Board) -> NDArray[np.float64]:
    """(V, bends) px per axis."""
    grid = residuals.reshape(-1, board.rows, board.columns, 2)
    places = board.points().reshape(board.rows, board.columns, 2)
    bends = _bends(grid, places[0, :, 0]), _bends(grid.swapaxes(1, 2), places[:, 0, 1])
    return np.concatenate([bend.reshape(len(grid), -1) for bend in bends], axis=1)


def _typical(bends: NDArray[np.float64]) -> float:
    bends = bends[np.isfinite(bends)]
    return (
        float(2**0.5 * SIGMA * np.median(np.abs(bends)))
        if bends.size >= FEWEST_BENDS
        else float("nan")
    )


def _bends(lines: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(V, lines, corners - 2, 2) of (V, lines, corners, 2): as far off the neighbours' line as
    noise of one unit would leave by one.
    """
    towards_last = ((places[1:-1] - places[:-2]) / (places[2:] - places[:-2]))[:, None]
    off = lines[:, :, 1:-1] - (1 - towards_last) * lines[:, :, :-2] - towards_last * lines[:, :, 2:]
    return np.asarray(off / np.sqrt(1 + towards_last**2 + (1 - towards_last) ** 2))


def burst_noise(residuals: NDArray[np.float64], poses: Sequence[int] | NDArray[np.int64]) -> float:
    """From pictures of one pose of the board: what differs between them.

    Each picture's own pose was fitted, so that a board that trembles in the hand adds nothing but
    its blur.

    Args:
        residuals: (V, corners of the board, 2) px, NaN where a corner was not seen.
        poses: (V,) equal for the pictures of one burst.

    Returns:
        px, root mean square of the two-dimensional noise; NaN if there are too few such pictures.
    """
    differences = []
    for pose in dict.fromkeys(np.asarray(poses).tolist()):
        own = _distinct(residuals[[index for index, other in enumerate(poses) if other == pose]])
        pictures = len(own)
        seen = np.isfinite(own).all((0, 2))
        free = 1 - 6 / max(7, 2 * int(seen.sum()))  # the six parameters of each picture's pose
        off = own[:, seen] - own[:, seen].mean(0)
        differences.append(
            (off / np.sqrt(free * (1 - 1 / pictures))).ravel() if pictures > 1 else np.empty(0)
        )
    off = np.concatenate(differences)
    if off.size < 20:
        return float("nan")
    return float(2**0.5 * SIGMA * np.median(np.abs(off)))


def _distinct(pictures: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P, ...) residuals without copies of one picture, which differ by rounding alone."""
    rounded = np.nan_to_num(pictures.reshape(len(pictures), -1) / COPY, nan=np.inf).round()
    _, first = np.unique(rounded, axis=0, return_index=True)
    return pictures[np.sort(first)]


def on_board(errors: Tensor, views: Sequence[View]) -> NDArray[np.float64]:
    """(M, 2) px of the seen corners to (V, corners of the board, 2), NaN where not seen."""
    full = np.full((len(views), len(views[0].weight), 2), np.nan)
    full[np.array([view.seen for view in views])] = errors.numpy()
    return full

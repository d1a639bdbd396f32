"""The noise of the detected corners, from what no smooth effect can explain."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.estimation.robust import SIGMA
from calib.session.board import Board

FEWEST_BENDS = 20


def short_scale_noise(residuals: NDArray[np.float64], board: Board) -> float:
    """The noise floor of a fit from its own residuals.

    What a corner is off the line through its two neighbours in a row or a column cancels what varies slowly over the board; with
    neighbours at equal distances, independent noise of variance s^2 gives that 1.5 s^2. The median absolute value keeps single bad
    corners out.

    Args:
        residuals: (V, corners of the board, 2) px, NaN where not seen.

    Returns:
        px, root mean square of the two-dimensional error that noise alone would leave; NaN with too few corners.
    """
    return _typical(_off_neighbours(residuals, board).ravel())


def noise_of_views(residuals: NDArray[np.float64], board: Board) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The same of each view by itself, (V,) px, NaN with too few corners, and its standard deviation over itself, (V,).

    The latter is measured: 1.5 over the root of the number of a view's bends where all of a board of 4x3 to 10x10 is seen, and 1.2 where
    half of its corners are missing here and there.
    """
    views = _off_neighbours(residuals, board)
    noise = np.array([_typical(view) for view in views])
    return noise, 1.5 / np.sqrt(np.maximum(np.isfinite(views).sum(1), 1))


def _off_neighbours(residuals: NDArray[np.float64], board: Board) -> NDArray[np.float64]:
    """(V, bends) px per axis."""
    grid = residuals.reshape(-1, board.rows, board.columns, 2)
    places = board.points().reshape(board.rows, board.columns, 2)
    bends = _bends(grid, places[0, :, 0]), _bends(grid.swapaxes(1, 2), places[:, 0, 1])
    return np.concatenate([bend.reshape(len(grid), -1) for bend in bends], axis=1)


def _typical(bends: NDArray[np.float64]) -> float:
    bends = bends[np.isfinite(bends)]
    return float(2**0.5 * SIGMA * np.median(np.abs(bends))) if bends.size >= FEWEST_BENDS else float("nan")


def _bends(lines: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(V, lines, corners - 2, 2) of (V, lines, corners, 2): as far off the neighbours' line as noise of one unit would leave by one."""
    towards_last = ((places[1:-1] - places[:-2]) / (places[2:] - places[:-2]))[:, None]
    off = lines[:, :, 1:-1] - (1 - towards_last) * lines[:, :, :-2] - towards_last * lines[:, :, 2:]
    return np.asarray(off / np.sqrt(1 + towards_last**2 + (1 - towards_last) ** 2))


def burst_noise(residuals: NDArray[np.float64], poses: Sequence[int] | NDArray[np.int64]) -> float:
    """From pictures of one pose of the board: what differs between them.

    Each picture's own pose was fitted, so that a board that trembles in the hand adds nothing but its blur.

    Args:
        residuals: (V, corners of the board, 2) px, NaN where a corner was not seen.
        poses: (V,) equal for the pictures of one burst.

    Returns:
        px, root mean square of the two-dimensional noise; NaN if there are too few such pictures.
    """
    differences = []
    for pose in dict.fromkeys(np.asarray(poses).tolist()):
        own = residuals[[index for index, other in enumerate(poses) if other == pose]]
        pictures = len(own)
        seen = np.isfinite(own).all((0, 2))
        free = 1 - 6 / max(7, 2 * int(seen.sum()))  # the six parameters of each picture's pose
        off = own[:, seen] - own[:, seen].mean(0)
        differences.append((off / np.sqrt(free * (1 - 1 / pictures))).ravel() if pictures > 1 else np.empty(0))
    off = np.concatenate(differences)
    if off.size < 20:
        return float("nan")
    return float(2**0.5 * SIGMA * np.median(np.abs(off)))


def on_board(errors: Tensor, views: Sequence[View]) -> NDArray[np.float64]:
    """(M, 2) px of the seen corners to (V, corners of the board, 2), NaN where not seen."""
    full = np.full((len(views), len(views[0].weight), 2), np.nan)
    full[np.array([view.seen for view in views])] = errors.numpy()
    return full

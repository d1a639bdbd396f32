"""The noise of the detected corners, from what no smooth effect can explain."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.estimation.robust import SIGMA
from calib.session.board import Board


def short_scale_noise(residuals: NDArray[np.float64], board: Board) -> float:
    """The noise floor of a fit from its own residuals.

    Second differences between a corner and its two neighbours in a row or a column cancel what varies slowly over the board; for
    independent noise of variance s^2 theirs is 6 s^2. The median absolute value keeps single bad corners out.

    Args:
        residuals: (V, corners of the board, 2) px, NaN where not seen.

    Returns:
        px, root mean square of the two-dimensional error that noise alone would leave; NaN with too few corners.
    """
    grid = residuals.reshape(-1, board.rows, board.columns, 2)
    along = grid[:, :, :-2] - 2 * grid[:, :, 1:-1] + grid[:, :, 2:]
    down = grid[:, :-2] - 2 * grid[:, 1:-1] + grid[:, 2:]
    bends = np.concatenate([along.ravel(), down.ravel()])
    bends = bends[np.isfinite(bends)]
    if bends.size < 20:
        return float("nan")
    return float(2**0.5 * SIGMA * np.median(np.abs(bends)) / 6**0.5)


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

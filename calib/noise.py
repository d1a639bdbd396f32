"""The noise of the detected corners, from what no smooth effect can explain."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.board import Board
from calib.robust import SIGMA
from calib.views import View


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


def on_board(errors: Tensor, views: Sequence[View]) -> NDArray[np.float64]:
    """(M, 2) px of the seen corners to (V, corners of the board, 2), NaN where not seen."""
    full = np.full((len(views), len(views[0].weight), 2), np.nan)
    full[np.array([view.seen for view in views])] = errors.numpy()
    return full

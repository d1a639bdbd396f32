"""The same corner comes first in every view.

A board can be read in two ways, a square one in four, that keep its shape and are no mirror image.
The colours of the squares tell them
apart where they can: the square diagonally outward of corner 0 is black. Where more than one
    reading is left, the one is taken whose
columns run most to the right in the picture. So a board that looks the same upside down (odd x odd,
even x even) must not be rolled by more than 90 degrees between views, nor a square one with an even
number of corners, which has four such readings, by more than 45.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.session.board import Board


def canonical_order(grey: NDArray, corners: NDArray, board: Board) -> NDArray[np.float64]:
    """Reorder a grid of corners.

    Args:
        grey: (H, W) uint8 or uint16, the picture.
        corners: (count, 2) px, a grid of the board's size, begun at any of its corners, in either
            direction; NaN where not seen, in whole rows and columns.

    Returns:
        (count, 2) px, row by row, columns fastest; y is clockwise of x in the picture.
    """
    grid = np.asarray(corners, np.float64).reshape(board.rows, board.columns, 2)
    readings = [grid, grid[::-1], grid[:, ::-1], grid[::-1, ::-1]]
    if board.columns == board.rows:
        readings += [reading.swapaxes(0, 1) for reading in readings]
    readings = [reading for reading in readings if _handedness(reading) > 0]
    black_first = [reading for reading in readings if starts_black(grey, reading)]
    return max(black_first or readings, key=_rightness).reshape(-1, 2)


def _handedness(grid: NDArray) -> float:
    """px^2, mean of x cross y over the squares: negative in a mirror image."""
    x, y = grid[:-1, 1:] - grid[:-1, :-1], grid[1:, :-1] - grid[:-1, :-1]
    return float(np.nanmean(x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0]))


def _rightness(grid: NDArray) -> float:
    """Cosine of the angle between the columns' direction and the picture's x."""
    along = np.nanmean(np.diff(grid, axis=1), (0, 1))
    return float(along[0] / np.hypot(*along))


def starts_black(grey: NDArray, grid: NDArray) -> bool:
    """Whether the squares coloured like the first, as the one outward of corner 0 is, are darker
    than their neighbours.
    """
    middles = ((grid[:-1, :-1] + grid[:-1, 1:] + grid[1:, :-1] + grid[1:, 1:]) / 4).astype(
        np.float32
    )
    light = np.asarray(
        cv2.remap(grey, middles[..., 0], middles[..., 1], cv2.INTER_LINEAR), np.float64
    )
    light[np.isnan(middles[..., 0])] = np.nan
    sign = (-1.0) ** np.add.outer(
        np.arange(light.shape[0]), np.arange(light.shape[1])
    )  # +1 where coloured like the first
    across = (light[:, :-1] - light[:, 1:]) * sign[:, :-1]
    down = (light[:-1] - light[1:]) * sign[:-1]
    return float(np.nanmedian(np.concatenate([across.ravel(), down.ravel()]))) < 0

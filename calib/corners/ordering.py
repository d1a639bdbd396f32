"""Choose the order of a checkerboard's corners so that the same corner comes first in every view.

A board has two readings, a square board four, that keep its shape and are not mirror images. The
colours of the squares distinguish them where they can: the square diagonally outward of corner 0 is
black. If more than one reading remains, the one is chosen whose rows run most to the right in the
picture. So a board that looks the same upside down (odd x odd, even x even) must not be rolled by
more than 90 degrees between views. A square board with an even number of corners has four such
readings and must not be rolled by more than 45 degrees.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.session.board import Board


def canonical_order(grey: NDArray, corners: NDArray, board: Board) -> NDArray[np.float64]:
    """Reorder a grid of corners.

    Args:
        grey: (H, W) uint8 or uint16, the picture.
        corners: (count, 2) px, a grid of the board's size that may start at any of its corners, in
            either direction; NaN where not visible, in full rows and columns.
        board: its columns and rows.

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
    """Return the mean of x cross y over the squares, px^2: negative in a mirror image."""
    x, y = grid[:-1, 1:] - grid[:-1, :-1], grid[1:, :-1] - grid[:-1, :-1]
    return float(np.nanmean(x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0]))


def _rightness(grid: NDArray) -> float:
    """Return the cosine of the angle between the direction of the rows and the picture's x."""
    direction = np.nanmean(np.diff(grid, axis=1), (0, 1))
    return float(direction[0] / np.hypot(*direction))


def starts_black(grey: NDArray, grid: NDArray) -> bool:
    """True if the squares with the colour of the first one, and of the one outward of corner 0, are
    darker than their neighbours.
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
    row_differences = (light[:, :-1] - light[:, 1:]) * sign[:, :-1]
    column_differences = (light[:-1] - light[1:]) * sign[:-1]
    return (
        float(np.nanmedian(np.concatenate([row_differences.ravel(), column_differences.ravel()])))
        < 0
    )

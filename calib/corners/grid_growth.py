"""Extend a detected grid of corners to the larger grid that it belongs to: add line after line on
each side, as long as the picture shows a third of the line.

Where something hides a corner, the detected grid ends, but the board continues around it. The
declared size of the board plays no part here: a larger board must not pass for the declared one.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.local_map import LocalMap
from calib.corners.measure import measure_corners
from calib.corners.outlier_corners import CORNER_NOISE, remove_outlier_corners
from calib.session.board import Board

Floats = NDArray[np.float64]

SIDES = range(4)  # quarters of a turn
MIN_LINES = 3  # of a grid that can be measured
MIN_VISIBLE_FRACTION = 0.3  # of a line of corners
WINDOW = 0.3  # of a square: cornerSubPix's half-size
WINDOW_LIMITS = (2, 10)  # px
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)


def grow_grid(grey: NDArray[np.uint8], every_bit: NDArray, grid: Floats) -> Floats:
    """Trim the outer lines on which less than a third of the places look like corners, and add the
    surrounding lines on which more do.

    Args:
        grey: (H, W), the picture in which corners are located.
        every_bit: (H, W) uint8 or uint16, the picture in which they are measured.
        grid: (rows, columns, 2) px.

    Returns:
        (rows, columns, 2) px, NaN where no corner is visible.
    """
    grid = _trim_lines(_keep_corners(every_bit, grid))
    complete_sides = 0
    side = 0
    while complete_sides < len(SIDES) and min(grid.shape[:2]) >= MIN_LINES:
        longer_grid = _add_line(grey, every_bit, np.rot90(grid, side))
        if longer_grid is None:
            complete_sides += 1
            side = (side + 1) % len(SIDES)
        else:
            complete_sides = 0
            grid = np.rot90(longer_grid, -side)
    return np.ascontiguousarray(grid)


def fill_grid(grid: Floats) -> Floats:
    """Return (rows, columns, 2) px with each NaN replaced by the prediction from the neighbours."""
    indices = np.stack(np.meshgrid(np.arange(grid.shape[1]), np.arange(grid.shape[0])), -1)
    points = indices.astype(np.float64)
    visible = np.isfinite(grid[..., 0])
    filled = grid.copy()
    if not visible.all():
        local_map = LocalMap.fit(points[visible], grid[visible], points[~visible], CORNER_NOISE)
        filled[~visible] = local_map.pixels
    return filled


def _keep_corners(grey: NDArray, grid: Floats) -> Floats:
    """Set to NaN what does not look like a corner, or lies where its neighbours do not predict
    it.
    """
    board = Board(grid.shape[1], grid.shape[0], 1.0)
    corners = remove_outlier_corners(grid.reshape(-1, 2), board)
    if not np.isfinite(corners).any():
        return corners.reshape(grid.shape)
    return remove_outlier_corners(measure_corners(grey, corners, board).corners, board).reshape(
        grid.shape
    )


def _add_line(grey: NDArray[np.uint8], every_bit: NDArray, grid: Floats) -> Floats | None:
    """Return the grid with one more line before its first; None if the picture does not show that
    line.
    """
    longer_grid = np.concatenate([np.full((1, *grid.shape[1:]), np.nan), grid])
    start = fill_grid(longer_grid)[0]
    half = int(
        np.clip(WINDOW * np.linalg.norm(np.diff(start, axis=0), axis=1).min(), *WINDOW_LIMITS)
    )
    interior = ((start >= half) & (start <= np.array(grey.shape[::-1]) - 1 - half)).all(1)
    if interior.sum() < MIN_VISIBLE_FRACTION * len(start):
        return None
    moved = cv2.cornerSubPix(
        grey, start[interior].reshape(-1, 1, 2).astype(np.float32), (half, half), (-1, -1), STOP
    )
    longer_grid[0, interior] = np.asarray(moved, np.float64).reshape(-1, 2)
    checked_grid = _keep_corners(every_bit, longer_grid)
    visible = np.isfinite(checked_grid[0, :, 0])
    if visible.sum() < MIN_VISIBLE_FRACTION * len(visible):
        return None
    longer_grid[0] = checked_grid[0]
    return longer_grid


def _trim_lines(grid: Floats) -> Floats:
    """Return the grid without the outer lines on which too few corners are visible."""
    complete_sides = 0
    while complete_sides < len(SIDES) and grid.size:
        if np.isfinite(grid[0, :, 0]).mean() < MIN_VISIBLE_FRACTION:
            grid = grid[1:]
            complete_sides = 0
        else:
            grid = np.rot90(grid)
            complete_sides += 1
    return np.rot90(grid, -complete_sides)

"""A grid of corners -> the larger one that it is a part of: line after line on each side, as long
as the picture shows a third of one.

What hides a corner leaves the detector a grid that ends there; the board goes on around it. How
large the board is declared to be does not
count: one that is larger is not to pass for it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.local_map import LocalMap
from calib.corners.measure import measure
from calib.corners.strays import FOUND_NOISE, without_strays
from calib.session.board import Board

Floats = NDArray[np.float64]

SIDES = range(4)  # quarters of a turn
FEWEST_LINES = 3  # of a grid that can be measured
LEAST_SEEN = 0.3  # of a line of corners
WINDOW = 0.3  # of a square: cornerSubPix's half-size
WINDOWS = (2, 10)  # px, its limits
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)


def grown(grey: NDArray[np.uint8], every_bit: NDArray, grid: Floats) -> Floats:
    """Less the lines at its ends of which less than a third looks like corners, and with those
    around it of which more does.

    Args:
        grey: (H, W), what is looked at.
        every_bit: (H, W) uint8 or uint16, what is measured.
        grid: (rows, columns, 2) px.

    Returns:
        (rows, columns, 2) px, NaN where no corner is seen.
    """
    grid = _trimmed(_seen(every_bit, grid))
    ended = 0
    side = 0
    while ended < len(SIDES) and min(grid.shape[:2]) >= FEWEST_LINES:
        longer = _with_line(grey, every_bit, np.rot90(grid, side))
        if longer is None:
            ended, side = ended + 1, (side + 1) % len(SIDES)
        else:
            ended, grid = 0, np.rot90(longer, -side)
    return np.ascontiguousarray(grid)


def filled(grid: Floats) -> Floats:
    """(rows, columns, 2) px, with those that are NaN where the others say."""
    points = np.stack(np.meshgrid(np.arange(grid.shape[1]), np.arange(grid.shape[0])), -1).astype(
        np.float64
    )
    seen = np.isfinite(grid[..., 0])
    there = (
        LocalMap.of(points[seen], grid[seen], points[~seen], FOUND_NOISE).pixels
        if not seen.all()
        else np.empty((0, 2))
    )
    whole = grid.copy()
    whole[~seen] = there
    return whole


def _seen(grey: NDArray, grid: Floats) -> Floats:
    """Those that look like corners, and lie as the others say."""
    board = Board(grid.shape[1], grid.shape[0], 1.0)
    corners = without_strays(grid.reshape(-1, 2), board)
    if not np.isfinite(corners).any():
        return corners.reshape(grid.shape)
    return without_strays(measure(grey, corners, board).corners, board).reshape(grid.shape)


def _with_line(grey: NDArray[np.uint8], every_bit: NDArray, grid: Floats) -> Floats | None:
    """With one more line before the first, if the picture shows it."""
    longer = np.concatenate([np.full((1, *grid.shape[1:]), np.nan), grid])
    start = filled(longer)[0]
    half = int(np.clip(WINDOW * np.linalg.norm(np.diff(start, axis=0), axis=1).min(), *WINDOWS))
    inside = ((start >= half) & (start <= np.array(grey.shape[::-1]) - 1 - half)).all(1)
    if inside.sum() < LEAST_SEEN * len(start):
        return None
    moved = cv2.cornerSubPix(
        grey, start[inside].reshape(-1, 1, 2).astype(np.float32), (half, half), (-1, -1), STOP
    )
    longer[0, inside] = np.asarray(moved, np.float64).reshape(-1, 2)
    found = _seen(every_bit, longer)
    new = np.isfinite(found[0, :, 0])
    if new.sum() < LEAST_SEEN * len(new):
        return None
    longer[0] = found[0]
    return longer


def _trimmed(grid: Floats) -> Floats:
    """Without the lines at its ends of which too few are seen."""
    sides = 0
    while sides < len(SIDES) and grid.size:
        if np.isfinite(grid[0, :, 0]).mean() < LEAST_SEEN:
            grid, sides = grid[1:], 0
        else:
            grid, sides = np.rot90(grid), sides + 1
    return np.rot90(grid, -sides)

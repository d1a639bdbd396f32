"""Find the size of the checkerboard that pictures show in place of the declared one.

Chance makes grids, too: gravel, text and fabric have corners that lie in rows. So a size counts
only where the squares of the grid are dark and light in turn, where it ends within the picture, and
where most pictures agree. The search is quick: it takes pictures of a few hundred px, and stops
when the answer is sure.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.detect import is_smooth_grid, largest_grid
from calib.corners.grid_growth import fill_grid
from calib.corners.picture_scale import reduce_picture, reducing_factor
from calib.corners.saddle_grid import CLUTTER, grid_of
from calib.corners.saddles import find_saddles

Floats = NDArray[np.float64]

PROBE_SIDES = (960, 480)
"""px, the longer sides of the reduced pictures: the smaller shows boards that are out of focus."""
MAX_SADDLES = CLUTTER + 1000
"""Saddles that are grouped: those of 30x30 corners, besides clutter."""
MIN_LINE = 0.5
"""Part of a line of the grid that must be seen: less is clutter beside the board."""
MIN_PRESENT = 0.9
"""Part of the grid that must be seen."""
MIN_CONTRAST = 8.0
"""Grey levels between dark and light squares."""
MIN_ALTERNATING = 0.95
"""Part of the squares that must be darker, or lighter, than their neighbours."""
MIN_SIDE = 4
"""Corners along a side of a board that two pictures prove. Of smaller ones, chance makes the same
size again and again.
"""
MIN_SMALL_CORNERS = 12
"""Corners of a smaller board, which only pictures of the number SMALL_AGREEMENT prove."""
SMALL_AGREEMENT = 5
SURE = 3
"""Pictures that agree, without one that does not, and end the search."""


@dataclass(frozen=True, slots=True)
class ShownSize:
    """The size of the board on which pictures agree."""

    columns: int
    """At least as many as rows."""
    rows: int
    pictures: tuple[int, ...]
    """The indices of the pictures that show it."""
    searched: int
    """The number of pictures that were searched until the answer was sure."""


def shown_size(pictures: Sequence[NDArray[np.uint8]]) -> ShownSize | None:
    """Return the size of the board on which most pictures with a grid agree; None if they do not
    agree, or too few show a grid.

    Args:
        pictures: (H, W) uint8.
    """
    votes: dict[tuple[int, int], list[int]] = {}
    searched = 0
    for picture in pictures:
        size = _size_of_grid(picture)
        if size is not None:
            votes.setdefault(size, []).append(searched)
        searched += 1
        if len(votes) == 1:
            [(size, voters)] = votes.items()
            if len(voters) >= _needed(size, pictures, SURE):
                break
    if not votes:
        return None
    size, voters = max(votes.items(), key=lambda vote: len(vote[1]))
    needed = _needed(size, pictures, min(2, len(pictures)))
    agree = len(voters) >= needed and 2 * len(voters) > sum(map(len, votes.values()))
    return ShownSize(*size, tuple(voters), searched) if agree else None


def _needed(size: tuple[int, int], pictures: Sequence[object], clear: int) -> int:
    """Return the number of pictures that prove a size; `clear`: for one that chance never makes."""
    return clear if min(size) >= MIN_SIDE else max(clear, min(SMALL_AGREEMENT, len(pictures)))


def _size_of_grid(picture: NDArray[np.uint8]) -> tuple[int, int] | None:
    """Return the columns and rows of a whole checkerboard in a (H, W) picture, at least as many
    columns as rows; None if there is none.
    """
    for side in PROBE_SIDES:
        small = reduce_picture(picture, reducing_factor(picture, side))
        grid = _by_saddles(small)
        if grid is None and (largest := largest_grid(small)) is not None:
            grid = largest.corners.reshape(largest.size[1], largest.size[0], 2)
        if grid is not None and _is_board(small, grid):
            rows, columns = grid.shape[:2]
            return max(columns, rows), min(columns, rows)
    return None


def _by_saddles(grey: NDArray[np.uint8]) -> Floats | None:
    """Return the (rows, columns, 2) px of the largest grid of saddles; None if it has gaps."""
    saddle_grid = grid_of(find_saddles(grey, MAX_SADDLES))
    if saddle_grid is None:
        return None
    grid = saddle_grid.points
    for _ in range(4):
        present = np.isfinite(grid[..., 0])
        rows = np.flatnonzero(present.mean(1) >= MIN_LINE)
        columns = np.flatnonzero(present.mean(0) >= MIN_LINE)
        if not (rows.size and columns.size):
            return None
        grid = grid[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    if min(grid.shape[:2]) < 3 or np.isfinite(grid[..., 0]).mean() < MIN_PRESENT:
        return None
    return fill_grid(grid)


def _is_board(grey: NDArray[np.uint8], grid: Floats) -> bool:
    """True if the (rows, columns, 2) px are the corners of a whole checkerboard."""
    if min(grid.shape[:2]) < 3 or grid.shape[0] * grid.shape[1] < MIN_SMALL_CORNERS:
        return False
    if not is_smooth_grid(grid):
        return False
    around = _pad(grid)
    low = around.min((0, 1))
    high = around.max((0, 1))
    if (low < 0).any() or (high > np.array(grey.shape[::-1]) - 1).any():
        return False  # it may go on beyond the picture
    smooth = np.asarray(cv2.GaussianBlur(grey, (3, 3), 0), np.uint8)
    steps = _steps(smooth, around)
    inner_steps = _steps(smooth, grid)
    if not (_alternate(np.concatenate(steps)) and _alternate(np.concatenate(inner_steps))):
        return False
    return not any(_continues(smooth, np.rot90(around, turn)) for turn in range(4))


def _continues(grey: NDArray[np.uint8], grid: Floats) -> bool:
    """True if squares go on before the first line of the (rows, columns, 2) px: then the grid is a
    part of a larger board.
    """
    border = _pad(grid)[:3, 1:-1]
    if (border < 0).any() or (border > np.array(grey.shape[::-1]) - 1).any():
        return False
    column_steps, row_steps = _steps(grey, border)
    return _alternate(np.concatenate([column_steps, row_steps]), 0.7)


def _pad(grid: Floats) -> Floats:
    """Return the grid with one more line on each side, as far away as the lines before it."""
    return np.pad(grid, ((1, 1), (1, 1), (0, 0)), mode="reflect", reflect_type="odd")


def _steps(grey: NDArray[np.uint8], grid: Floats) -> tuple[Floats, Floats]:
    """Return the grey levels from the light to the dark one of each two neighbouring squares along
    the columns, then along the rows; negative where the other one is darker.
    """
    middles = (grid[:-1, :-1] + grid[:-1, 1:] + grid[1:, :-1] + grid[1:, 1:]) / 4
    places = middles.astype(np.float32)
    light = cv2.remap(grey, places[..., 0], places[..., 1], cv2.INTER_LINEAR).astype(np.float64)
    sign = np.where(np.indices(light.shape).sum(0) % 2, 1, -1)
    column_steps = np.diff(light, axis=0) * sign[:-1]
    row_steps = np.diff(light, axis=1) * sign[:, :-1]
    return column_steps.ravel(), row_steps.ravel()


def _alternate(steps: Floats, fraction: float = MIN_ALTERNATING) -> bool:
    """True if this part of the steps have one sign and enough contrast."""
    upward = (steps > MIN_CONTRAST).mean()
    downward = (steps < -MIN_CONTRAST).mean()
    return bool(max(upward, downward) >= fraction)

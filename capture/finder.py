"""Where a checkerboard is in a live picture, quickly, and what the gate wants to know of it.

The search runs in a picture reduced by a whole number, where squares of 5 px are found: of 10 px at
1640x1232, of 20 at 3280x2464. Only the board's squares are looked at in full: their edges for
sharpness, their insides for the exposure, and their corners once a frame is to be kept.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.detect import half_window, is_regular, refine, shows_two
from calib.corners.find import describe_two_boards
from calib.corners.ordering import canonical_order
from calib.corners.picture_scale import enlarge_corners, live_factor, reduce_picture
from calib.corners.saddle_grid import SaddleGrid, find_grid
from calib.session.board import Board
from capture.exposure import measure_exposure
from capture.frames import Frame
from capture.sharpness import measure_blur
from capture.sighting import Sighting, grey_of, side


class Finder:
    """Keeps nothing from frame to frame."""

    def __init__(self, board: Board) -> None:
        self._board = board

    def look(self, frame: Frame) -> Sighting:
        grey = grey_of(frame)
        height, width = grey.shape
        factor = live_factor(grey)
        partial = Sighting(None, width, height, frame.time_s)
        for coarser in (
            factor,
            min(2 * factor, height, width),
        ):  # the second sees boards that are out of focus
            small = reduce_picture(grey, coarser)
            grid = find_grid(small, self._board)
            if grid is None:
                continue
            corners = self._whole(grid, small)
            if corners is not None and shows_two(grid, self._board):
                return replace(partial, problem=describe_two_boards(self._board))
            if corners is not None:
                return self._measured(grey, enlarge_corners(corners, coarser), frame.time_s)
            if partial.part is None:
                part, larger = (
                    enlarge_corners(grid.points[grid.present], coarser),
                    self._is_larger(grid),
                )
                partial = replace(
                    partial, part=part, too_large=larger, square=side(grid.points) * coarser
                )
        return partial

    def refine(self, frame: Frame, sighting: Sighting) -> NDArray[np.float64] | None:
        """(count, 2) px, to some hundredths, as `calib.corners` starts from; only the board's area
        is touched. None: no regular board.
        """
        if sighting.corners is None:
            return None
        grey = grey_of(frame)
        around = 3 * half_window(sighting.corners, self._board)
        low = np.maximum(np.floor(sighting.corners.min(0)).astype(int) - around, 0)
        high = np.ceil(sighting.corners.max(0)).astype(int) + around + 1
        area = np.ascontiguousarray(grey[low[1] : high[1], low[0] : high[0]])
        corners = refine(area, sighting.corners - low, self._board)
        return (
            canonical_order(area, corners, self._board) + low
            if is_regular(corners, self._board, area.shape)
            else None
        )

    def _whole(self, grid: SaddleGrid, small: NDArray[np.uint8]) -> NDArray[np.float64] | None:
        """(count, 2) px of the reduced picture, if the grid is the board."""
        for whole in grid.board_positions(self._board):
            corners = refine(small, whole, self._board)
            if is_regular(corners, self._board, small.shape):
                return canonical_order(small, corners, self._board)
        return None

    def _measured(
        self, grey: NDArray[np.uint8], corners: NDArray[np.float64], time_s: float
    ) -> Sighting:
        height, width = grey.shape
        return Sighting(
            corners,
            width,
            height,
            time_s,
            square=side(corners.reshape(self._board.rows, self._board.columns, 2)),
            window=half_window(corners, self._board),
            blur=measure_blur(grey, corners, self._board),
            exposure=measure_exposure(grey, corners, self._board),
        )

    def _is_larger(self, grid: SaddleGrid) -> bool:
        """Only lines that are at least half there count: a saddle or two at the rim are chance."""
        columns, rows = (int((grid.present.mean(axis) > 0.5).sum()) for axis in (0, 1))
        return max(columns, rows) > max(self._board.columns, self._board.rows) or min(
            columns, rows
        ) > min(self._board.columns, self._board.rows)

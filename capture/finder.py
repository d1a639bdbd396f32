"""The finder of a checkerboard in a live picture: quick, and with all that the gate needs.

The search runs in a picture that is reduced by a whole number. There it finds squares of 5 px: of
10 px at 1640x1232, of 20 px at 3280x2464. The full picture is read only at the board's squares: at
their edges for sharpness, inside them for the exposure, and at their corners once a frame is to be
kept.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.detect import half_window, is_regular, refine, shows_two
from calib.corners.find import describe_two_boards
from calib.corners.ordering import canonical_order
from calib.corners.picture_scale import enlarge_corners, reduce_picture, reducing_factor
from calib.corners.saddle_grid import SaddleGrid, find_grid
from calib.session.board import Board
from capture.exposure import measure_exposure
from capture.frames import Frame
from capture.live_detection import LiveDetection, grey_of, mean_spacing
from capture.sharpness import measure_blur


class Finder:
    """A finder of one checkerboard; it keeps nothing from frame to frame."""

    def __init__(self, board: Board) -> None:
        self._board = board

    def look(self, frame: Frame) -> LiveDetection:
        grey = grey_of(frame)
        height, width = grey.shape
        factor = reducing_factor(grey)
        partial = LiveDetection(None, width, height, frame.time_s)
        for reduction in (
            factor,
            min(2 * factor, height, width),
        ):  # the second size finds boards that are out of focus
            small = reduce_picture(grey, reduction)
            grid = find_grid(small, self._board)
            if grid is None:
                continue
            corners = self._find_board(grid, small)
            if corners is not None and shows_two(grid, self._board):
                return replace(partial, problem=describe_two_boards(self._board))
            if corners is not None:
                return self._measure(grey, enlarge_corners(corners, reduction), frame.time_s)
            if partial.partial_corners is None:
                partial = replace(
                    partial,
                    partial_corners=enlarge_corners(grid.points[grid.present], reduction),
                    too_large=self._is_larger(grid),
                    square=mean_spacing(grid.points) * reduction,
                )
        return partial

    def refine(self, frame: Frame, detection: LiveDetection) -> NDArray[np.float64] | None:
        """Return (count, 2) px, accurate to some hundredths, as `calib.corners` starts from. It
        reads only the board's area. None: the corners are not those of a regular board.
        """
        if detection.corners is None:
            return None
        grey = grey_of(frame)
        border = 3 * half_window(detection.corners, self._board)
        low = np.maximum(np.floor(detection.corners.min(0)).astype(int) - border, 0)
        high = np.ceil(detection.corners.max(0)).astype(int) + border + 1
        crop = np.ascontiguousarray(grey[low[1] : high[1], low[0] : high[0]])
        corners = refine(crop, detection.corners - low, self._board)
        return (
            canonical_order(crop, corners, self._board) + low
            if is_regular(corners, self._board, crop.shape)
            else None
        )

    def _find_board(self, grid: SaddleGrid, small: NDArray[np.uint8]) -> NDArray[np.float64] | None:
        """Return (count, 2) px in the reduced picture if the grid is the board; else None."""
        for candidate in grid.board_positions(self._board):
            corners = refine(small, candidate, self._board)
            if is_regular(corners, self._board, small.shape):
                return canonical_order(small, corners, self._board)
        return None

    def _measure(
        self, grey: NDArray[np.uint8], corners: NDArray[np.float64], time_s: float
    ) -> LiveDetection:
        height, width = grey.shape
        return LiveDetection(
            corners,
            width,
            height,
            time_s,
            square=mean_spacing(corners.reshape(self._board.rows, self._board.columns, 2)),
            margin=half_window(corners, self._board),
            blur=measure_blur(grey, corners, self._board),
            exposure=measure_exposure(grey, corners, self._board),
        )

    def _is_larger(self, grid: SaddleGrid) -> bool:
        """Return True if the grid has more lines than the board. Only lines that are at least half
        visible count: a saddle or two at the rim are chance.
        """
        columns = int((grid.present.mean(0) > 0.5).sum())
        rows = int((grid.present.mean(1) > 0.5).sum())
        return max(columns, rows) > max(self._board.columns, self._board.rows) or min(
            columns, rows
        ) > min(self._board.columns, self._board.rows)

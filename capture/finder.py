"""Where a checkerboard is in a live picture, quickly, and what the gate wants to know of it.

The search runs in a picture reduced by a whole number, where squares of 5 px are found: of 10 px at 1640x1232, of 20 at 3280x2464. Only
the board's squares are looked at in full: their edges for sharpness, their insides for the exposure, and their corners once a frame is to
be kept.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.detect import half_window, is_regular, refine
from calib.corners.ordering import canonical_order
from calib.session.board import Board
from capture.exposure import measure_exposure
from capture.frames import Frame
from capture.lattice import Lattice, find_lattice
from capture.saddles import find_saddles
from capture.sharpness import measure_blur
from capture.sighting import Sighting, enlarged, grey_of, live_factor, reduced, side

CLUTTER = 300  # saddles besides the board's, stronger than the weakest of its corners


class Finder:
    """Keeps nothing from frame to frame."""

    def __init__(self, board: Board) -> None:
        self._board = board

    def look(self, frame: Frame) -> Sighting:
        grey = grey_of(frame)
        height, width = grey.shape
        factor = live_factor(grey)
        partial = Sighting(None, width, height, frame.time_s)
        for coarser in (factor, min(2 * factor, height, width)):  # the second sees boards that are out of focus
            small = reduced(grey, coarser)
            lattice = find_lattice(find_saddles(small, CLUTTER + self._board.count))
            if lattice is None:
                continue
            corners = self._whole(lattice, small)
            if corners is not None:
                return self._measured(grey, enlarged(corners, coarser), frame.time_s)
            if partial.part is None:
                part, larger = enlarged(lattice.points[lattice.seen], coarser), self._is_larger(lattice)
                partial = replace(partial, part=part, too_large=larger, square=side(lattice.points) * coarser)
        return partial

    def refine(self, frame: Frame, sighting: Sighting) -> NDArray[np.float64] | None:
        """(count, 2) px, to some hundredths, as `calib.corners` starts from; only the board's area is touched. None: no regular board."""
        if sighting.corners is None:
            return None
        grey = grey_of(frame)
        around = 3 * half_window(sighting.corners, self._board)
        low = np.maximum(np.floor(sighting.corners.min(0)).astype(int) - around, 0)
        high = np.ceil(sighting.corners.max(0)).astype(int) + around + 1
        area = np.ascontiguousarray(grey[low[1] : high[1], low[0] : high[0]])
        corners = refine(area, sighting.corners - low, self._board)
        return canonical_order(area, corners, self._board) + low if is_regular(corners, self._board, area.shape) else None

    def _whole(self, lattice: Lattice, small: NDArray[np.uint8]) -> NDArray[np.float64] | None:
        """(count, 2) px of the reduced picture, if the lattice is the board: a stray saddle at its rim does not matter."""
        for points in (lattice.points, lattice.points.swapaxes(0, 1)):
            grid = _complete(points, self._board)
            if grid is not None:
                corners = refine(small, grid.reshape(-1, 2), self._board)
                if is_regular(corners, self._board, small.shape):
                    return canonical_order(small, corners, self._board)
        return None

    def _measured(self, grey: NDArray[np.uint8], corners: NDArray[np.float64], time_s: float) -> Sighting:
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

    def _is_larger(self, lattice: Lattice) -> bool:
        """Only lines that are at least half there count: a saddle or two at the rim are chance."""
        columns, rows = (int((lattice.seen.mean(axis) > 0.5).sum()) for axis in (0, 1))
        return max(columns, rows) > max(self._board.columns, self._board.rows) or min(columns, rows) > min(
            self._board.columns, self._board.rows
        )


def _complete(points: NDArray, board: Board) -> NDArray[np.float64] | None:
    """The (rows, columns, 2) window in which every corner was found, if there is one, with few saddles beside it."""
    seen = np.isfinite(points[..., 0])
    if seen.shape[0] < board.rows or seen.shape[1] < board.columns or seen.sum() - board.count > 0.5 * min(board.rows, board.columns):
        return None
    windows = np.lib.stride_tricks.sliding_window_view(seen, (board.rows, board.columns)).all((-1, -2))
    row, column = np.unravel_index(windows.argmax(), windows.shape)
    return np.asarray(points[row : row + board.rows, column : column + board.columns]) if windows.any() else None

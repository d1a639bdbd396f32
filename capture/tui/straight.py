"""The live picture without the cover's distortion, at one depth: maps as large as the screen shows
it, and straight lines over it.

The maps are made by the screen's child, for torch is never loaded in the process that draws; the
rest is pure.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.progress import Progress
from calib.session.board import Board
from capture.tui.camera import Preview, shown_factor
from capture.tui.cells import LINE, Mark
from capture.tui.child import LOADING

NODES = (65, 49)
"""Columns and rows of the grid on which points are straightened: between them by less than what a
screen shows.
"""
GRID = 6
"""Parts in which lines divide a picture without a board, across and down."""


@dataclass(frozen=True, slots=True, eq=False)
class Straight:
    """What a bare pinhole camera would see of what is at one depth."""

    depth: float
    """m"""
    size: tuple[int, int]
    """Width and height of the camera's pictures, px."""
    x: NDArray[np.float32]
    """(h, w) px: where the camera's picture has what the straight one, reduced to h by w, shows;
    far outside where it sees nothing.
    """
    y: NDArray[np.float32]
    nodes: NDArray[np.float32]
    """(rows, columns, 2) px of the straight picture, of points spread evenly from corner to corner
    of the camera's.
    """

    def preview(self, seen: Preview) -> Preview:
        """The same picture, straightened."""
        return replace(
            seen, grey=self._straightened(seen.grey), image=self._straightened(seen.image)
        )

    def points(self, seen: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2) px of the camera's picture to the straight one; NaN stays so."""
        last = np.array(self.nodes.shape[1::-1]) - 1
        at = seen / (np.array(self.size) - 1) * last  # (n, 2) columns and rows of the nodes
        inside = ((at >= 0) & (at <= last)).all(1)
        column, row = np.minimum(at[inside], last - 1).astype(np.int64).T
        right, below = (at[inside] - np.stack([column, row], -1)).T[..., None]
        upper = (1 - right) * self.nodes[row, column] + right * self.nodes[row, column + 1]
        lower = (1 - right) * self.nodes[row + 1, column] + right * self.nodes[row + 1, column + 1]
        found = np.full(seen.shape, np.nan)
        found[inside] = (1 - below) * upper + below * lower
        return found

    def marks(self, seen: Sequence[Mark], board: Board) -> list[Mark]:
        """What is marked, where the straight picture has it; and straight lines, along rows and
        columns of the board if there is one.
        """
        straight = [replace(mark, points=self.points(mark.points)) for mark in seen]
        found = next(
            (
                mark.points
                for mark in straight
                if not mark.closed and len(mark.points) == board.columns * board.rows
            ),
            None,
        )
        return [
            *straight,
            *(
                Mark(LINE, ends, closed=True)
                for ends in (self._grid() if found is None else along(found, board))
            ),
        ]

    def _straightened(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        height, width = image.shape[:2]
        across, down = (
            cv2.resize(each, (width, height), interpolation=cv2.INTER_NEAREST)
            for each in (self.x, self.y)
        )
        factor, half = shown_factor(self.size), np.float32(0.5)
        wide, high = (
            side // factor * factor for side in self.size
        )  # what is left at the end is not shown
        x, y = (
            (across + half) * np.float32(width / wide) - half,
            (down + half) * np.float32(height / high) - half,
        )
        return np.asarray(
            cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT), np.uint8
        )

    def _grid(self) -> list[NDArray[np.float64]]:
        wide, high = self.size
        parts = np.arange(1, GRID) / GRID
        across = [np.array([[0, part * high], [wide - 1, part * high]]) for part in parts]
        return across + [np.array([[part * wide, 0], [part * wide, high - 1]]) for part in parts]


def along(corners: NDArray[np.float64], board: Board) -> list[NDArray[np.float64]]:
    """(2, 2) px each: from the first to the last corner that is seen of every row and column, of
    (count, 2) px.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    lines = [*grid, *grid.transpose(1, 0, 2)]
    seen = [line[np.isfinite(line[:, 0])] for line in lines]
    return [line[[0, -1]] for line in seen if len(line) > 1]


def straighten(progress: Progress, calibration: Path, depth: float) -> dict[str, object]:
    """In the child: `straight`, for that depth in m.

    InputError: the calibration cannot be read, or the depth is none that it sees.
    """
    progress.task(LOADING, 1)
    from calib.calibration import Calibration
    from calib.undistortion.window import Window

    field = Calibration.load(calibration).ray_field()
    size = field.width, field.height
    factor = shown_factor(size)
    width, height = (side // factor for side in size)
    made = field.map_at(depth, Window(width, height, 2 * ((factor - 1) / 2,), 2 * (float(factor),)))
    far = np.float32(-1e5)
    x, y = (np.where(made.valid, each, far) for each in (made.x, made.y))
    across, down = np.meshgrid(
        np.linspace(0, size[0] - 1, NODES[0]), np.linspace(0, size[1] - 1, NODES[1])
    )
    nodes = field.undistort_pixels(np.column_stack([across.ravel(), down.ravel()]), depth)
    return {
        "straight": Straight(depth, size, x, y, nodes.reshape(*across.shape, 2).astype(np.float32))
    }

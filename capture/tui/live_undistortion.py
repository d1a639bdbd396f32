"""The live picture without the cover's distortion, at one depth: maps in the size of the screen's
picture, and straight lines over it.

The screen's child process makes the maps, because the process that draws never loads torch;
everything else is pure.
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
from capture.tui.cells import LINE_MARK, Mark
from capture.tui.child import LOADING

NODES = (65, 49)
"""The columns and rows of the grid on which points are undistorted: interpolation between them errs
by less than a screen shows.
"""
GRID_DIVISIONS = 6
"""The number of fields in each direction into which lines divide a picture without a board."""


@dataclass(frozen=True, slots=True, eq=False)
class LiveUndistortion:
    """The undistortion at one depth: the picture that a bare pinhole camera would take of a scene
    there.
    """

    depth: float
    """m"""
    size: tuple[int, int]
    """Width and height of the camera's pictures, px."""
    x: NDArray[np.float32]
    """(h, w) px, x in the camera's picture for each pixel of the undistorted one, which is reduced
    to h by w; far outside where the camera sees nothing.
    """
    y: NDArray[np.float32]
    nodes: NDArray[np.float32]
    """(rows, columns, 2) px in the undistorted picture, for points spread evenly from corner to
    corner of the camera's picture.
    """

    def preview(self, preview: Preview) -> Preview:
        """Return the same picture, undistorted."""
        return replace(
            preview, grey=self._undistort(preview.grey), image=self._undistort(preview.image)
        )

    def points(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map (n, 2) px of the camera's picture to the undistorted one; NaN stays NaN."""
        last = np.array(self.nodes.shape[1::-1]) - 1
        positions = pixels / (np.array(self.size) - 1) * last  # (n, 2) columns and rows of nodes
        mask = ((positions >= 0) & (positions <= last)).all(1)
        cells = np.minimum(positions[mask], last - 1).astype(np.int64)  # (m, 2)
        column = cells[:, 0]
        row = cells[:, 1]
        weights = positions[mask] - cells
        right = weights[:, :1]
        below = weights[:, 1:]
        upper = (1 - right) * self.nodes[row, column] + right * self.nodes[row, column + 1]
        lower = (1 - right) * self.nodes[row + 1, column] + right * self.nodes[row + 1, column + 1]
        undistorted = np.full(pixels.shape, np.nan)
        undistorted[mask] = (1 - below) * upper + below * lower
        return undistorted

    def marks(self, marks: Sequence[Mark], board: Board) -> list[Mark]:
        """Return the marks where the undistorted picture has them, and straight lines: along rows
        and columns of the board if there is one, else over the full picture.
        """
        undistorted = [replace(mark, points=self.points(mark.points)) for mark in marks]
        corners = next(
            (
                mark.points
                for mark in undistorted
                if not mark.closed and len(mark.points) == board.columns * board.rows
            ),
            None,
        )
        return [
            *undistorted,
            *(
                Mark(LINE_MARK, ends, closed=True)
                for ends in (self._grid() if corners is None else board_lines(corners, board))
            ),
        ]

    def _undistort(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        height, width = image.shape[:2]
        map_x = cv2.resize(self.x, (width, height), interpolation=cv2.INTER_NEAREST)
        map_y = cv2.resize(self.y, (width, height), interpolation=cv2.INTER_NEAREST)
        factor = shown_factor(self.size)
        half = np.float32(0.5)
        shown_width = self.size[0] // factor * factor  # the remainder is not shown
        shown_height = self.size[1] // factor * factor
        x = (map_x + half) * np.float32(width / shown_width) - half
        y = (map_y + half) * np.float32(height / shown_height) - half
        return np.asarray(
            cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT), np.uint8
        )

    def _grid(self) -> list[NDArray[np.float64]]:
        width, height = self.size
        fractions = np.arange(1, GRID_DIVISIONS) / GRID_DIVISIONS
        rows = [np.array([[0, f * height], [width - 1, f * height]]) for f in fractions]
        columns = [np.array([[f * width, 0], [f * width, height - 1]]) for f in fractions]
        return rows + columns


def board_lines(corners: NDArray[np.float64], board: Board) -> list[NDArray[np.float64]]:
    """Return lines of (2, 2) px each, from the first to the last visible corner of every row and
    column of the (count, 2) px corners.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    lines = [*grid, *grid.transpose(1, 0, 2)]
    visible = [line[np.isfinite(line[:, 0])] for line in lines]
    return [line[[0, -1]] for line in visible if len(line) > 1]


def make_undistortion(progress: Progress, calibration: Path, depth: float) -> dict[str, object]:
    """Run in the child: return `straight`, the undistortion for this depth in m.

    InputError: the calibration cannot be read, or no ray reaches this depth.
    """
    progress.task(LOADING, 1)
    from calib.calibration import Calibration
    from calib.undistortion.window import Window

    field = Calibration.load(calibration).ray_field()
    size = field.width, field.height
    factor = shown_factor(size)
    width = size[0] // factor
    height = size[1] // factor
    depth_map = field.map_at(
        depth, Window(width, height, 2 * ((factor - 1) / 2,), 2 * (float(factor),))
    )
    far = np.float32(-1e5)
    x = np.where(depth_map.valid, depth_map.x, far)
    y = np.where(depth_map.valid, depth_map.y, far)
    node_x, node_y = np.meshgrid(
        np.linspace(0, size[0] - 1, NODES[0]), np.linspace(0, size[1] - 1, NODES[1])
    )
    nodes = field.undistort_pixels(np.column_stack([node_x.ravel(), node_y.ravel()]), depth)
    return {
        "straight": LiveUndistortion(
            depth, size, x, y, nodes.reshape(*node_x.shape, 2).astype(np.float32)
        )
    }

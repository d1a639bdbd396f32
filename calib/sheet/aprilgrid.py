"""Draw Kalibr's AprilGrid: tags of the family 36h11, numbered from the lower left, whose corners
touch those of small black squares.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calib.sheet.marker import black_rectangles, check_marker_count, draw_marker_cells
from calib.sheet.target import PatternDrawing, Polygon, rectangle

FAMILY = "DICT_APRILTAG_36h11"
BORDER = 2  # cells: Kalibr's tags have one more than other markers


@dataclass(frozen=True, slots=True)
class AprilGridPattern:
    """An AprilGrid of any size."""

    columns: int
    """Tags along x."""
    rows: int
    """Tags along y."""
    spacing: float = 0.3
    """The gap between two tags in sides of a tag, Kalibr's tagSpacing."""

    @property
    def extent(self) -> tuple[float, float]:
        """Width and height in sides of a tag, with the small squares around the outermost tags."""
        return (
            self.columns * (1 + self.spacing) + self.spacing,
            self.rows * (1 + self.spacing) + self.spacing,
        )

    @property
    def title(self) -> str:
        return f"AprilGrid, {self.columns} × {self.rows} tags (36h11), spacing {self.spacing:g}"

    @property
    def cell(self) -> str:
        return "tag"

    def draw(self, side: float) -> PatternDrawing:
        """Draw the board; its corners come row by row from the upper left, two for each tag in a
        row.
        """
        check_marker_count(FAMILY, self.columns * self.rows)
        small, pitch = self.spacing * side, (1 + self.spacing) * side
        polygons: list[Polygon] = [
            rectangle(i * pitch, j * pitch, small, small)
            for j in range(self.rows + 1)
            for i in range(self.columns + 1)
        ]
        for j in range(self.rows):
            for i in range(self.columns):
                number = (self.rows - 1 - j) * self.columns + i
                upright = np.rot90(
                    draw_marker_cells(FAMILY, number, BORDER), 2
                )  # OpenCV has the family upside down
                polygons += black_rectangles(upright, i * pitch + small, j * pitch + small, side)
        x = [n * pitch + small + end for n in range(self.columns) for end in (0, side)]
        y = [n * pitch + small + end for n in range(self.rows) for end in (0, side)]
        corners = tuple((corner_x, corner_y) for corner_y in y for corner_x in x)
        return PatternDrawing(tuple(polygons), corners)

    def to_yaml(self, side: float, entry: object) -> Mapping[str, object]:
        del side
        return {
            "type": "aprilgrid",
            "columns": self.columns,
            "rows": self.rows,
            "tag_mm": entry,
            "spacing": self.spacing,
        }

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows} tags"

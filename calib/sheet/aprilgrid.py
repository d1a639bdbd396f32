"""Kalibr's AprilGrid: tags of the family 36h11 whose corners touch those of small black squares,
numbered from the lower left.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calib.sheet.marker import black_bits, black_of, check_count
from calib.sheet.target import Polygon, Target, rectangle

FAMILY = "DICT_APRILTAG_36h11"
BORDER = 2  # cells: Kalibr's, one more than elsewhere


@dataclass(frozen=True, slots=True)
class AprilGrid:
    columns: int
    """Tags along x."""
    rows: int
    """Tags along y."""
    spacing: float = 0.3
    """Between two tags, in sides of a tag: Kalibr's tagSpacing."""

    @property
    def extent(self) -> tuple[float, float]:
        """With the small squares around the outermost tags."""
        return (
            self.columns * (1 + self.spacing) + self.spacing,
            self.rows * (1 + self.spacing) + self.spacing,
        )

    @property
    def title(self) -> str:
        return f"AprilGrid, {self.columns} × {self.rows} tags (36h11), spacing {self.spacing:g}"

    @property
    def part(self) -> str:
        return "tag"

    def draw(self, side: float) -> Target:
        """Corners row by row from the upper left, two for each tag in a row."""
        check_count(FAMILY, self.columns * self.rows)
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
                    black_bits(FAMILY, number, BORDER), 2
                )  # OpenCV has the family upside down
                polygons += black_of(upright, i * pitch + small, j * pitch + small, side)
        x, y = (
            [n * pitch + small + end for n in range(count) for end in (0, side)]
            for count in (self.columns, self.rows)
        )
        return Target(tuple(polygons), tuple((across, down) for down in y for across in x))

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

"""Draw a checkerboard. Its upper left square is black, like the square up-left of the first corner
in every view.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from calib.sheet.target import PatternDrawing, rectangle


@dataclass(frozen=True, slots=True)
class CheckerboardPattern:
    """A checkerboard of any size."""

    columns: int
    """Inner corners along x."""
    rows: int
    """Inner corners along y."""

    @property
    def extent(self) -> tuple[float, float]:
        return self.columns + 1, self.rows + 1

    @property
    def title(self) -> str:
        return f"Checkerboard, {self.columns} × {self.rows} inner corners"

    @property
    def cell(self) -> str:
        return "square"

    @property
    def looks_the_same_upside_down(self) -> bool:
        return (self.columns + self.rows) % 2 == 0

    def draw(self, side: float) -> PatternDrawing:
        black = (
            (i, j)
            for j in range(self.rows + 1)
            for i in range(self.columns + 1)
            if (i + j) % 2 == 0
        )
        return PatternDrawing(
            tuple(rectangle(i * side, j * side, side, side) for i, j in black),
            tuple(
                (i * side, j * side)
                for j in range(1, self.rows + 1)
                for i in range(1, self.columns + 1)
            ),
        )

    def to_yaml(self, side: float, entry: object) -> Mapping[str, object]:
        del side
        return {"columns": self.columns, "rows": self.rows, "square_mm": entry}

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows} corners"

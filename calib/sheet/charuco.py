"""Draw a ChArUco board like OpenCV: a checkerboard with a marker in each white square."""

from collections.abc import Mapping
from dataclasses import dataclass

from calib.sheet.marker import black_rectangles, check_marker_count, draw_marker_cells
from calib.sheet.target import PatternDrawing, Polygon, rectangle


@dataclass(frozen=True, slots=True)
class CharucoPattern:
    """A ChArUco board of any size."""

    columns: int
    """Inner corners along x: one fewer than OpenCV's squares."""
    rows: int
    """Inner corners along y."""
    marker: float = 0.75
    """The side of a marker in sides of a square."""
    dictionary: str = "DICT_4X4_250"
    legacy_pattern: bool = False
    """True if a board with an even number of rows of squares starts with a white square, as
    OpenCV's did before 4.6.
    """

    @property
    def extent(self) -> tuple[float, float]:
        return self.columns + 1, self.rows + 1

    @property
    def title(self) -> str:
        legacy = ", legacy pattern" if self.legacy_pattern else ""
        return (
            f"ChArUco, {self.columns} × {self.rows} inner corners, {self.dictionary}{legacy},"
            f" markers of {self.marker:g} of a square"
        )

    @property
    def cell(self) -> str:
        return "square"

    def draw(self, side: float) -> PatternDrawing:
        squares = [(i, j) for j in range(self.rows + 1) for i in range(self.columns + 1)]
        first_white = int(self.legacy_pattern and self.rows % 2 == 1)
        white = [(i, j) for i, j in squares if (i + j + first_white) % 2 == 1]
        check_marker_count(self.dictionary, len(white))
        polygons: list[Polygon] = [
            rectangle(i * side, j * side, side, side)
            for i, j in squares
            if (i + j + first_white) % 2 == 0
        ]
        margin = (1 - self.marker) / 2
        for number, (i, j) in enumerate(white):
            bits = draw_marker_cells(self.dictionary, number, border=1)
            polygons += black_rectangles(
                bits, (i + margin) * side, (j + margin) * side, self.marker * side
            )
        corners = tuple(
            (i * side, j * side)
            for j in range(1, self.rows + 1)
            for i in range(1, self.columns + 1)
        )
        return PatternDrawing(tuple(polygons), corners)

    def to_yaml(self, side: float, entry: object) -> Mapping[str, object]:
        return {
            "type": "charuco",
            "columns": self.columns,
            "rows": self.rows,
            "square_mm": entry,
            "marker_mm": round(self.marker * side, 4),
            "dictionary": self.dictionary,
            "legacy_pattern": self.legacy_pattern,
        }

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows} corners"

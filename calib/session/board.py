"""The checkerboard: how many inner corners, how far apart, and where they are."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Board:
    """A flat checkerboard. Corners come row by row, columns fastest."""

    columns: int
    """Inner corners along x."""
    rows: int
    """Inner corners along y."""
    square: float
    """m, side of a square."""

    @property
    def count(self) -> int:
        return self.columns * self.rows

    def points(self) -> NDArray[np.float64]:
        """(count, 2) m, the corners in board coordinates: origin at the board's centre, x along columns, y along rows."""
        x = (np.arange(self.columns) - (self.columns - 1) / 2) * self.square
        y = (np.arange(self.rows) - (self.rows - 1) / 2) * self.square
        return np.stack(np.meshgrid(x, y, indexing="xy"), axis=-1).reshape(-1, 2)

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"

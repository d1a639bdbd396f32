"""The checkerboard: how many inner corners, how far apart, and where they are."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calib.session.tolerances import SQUARE_SIDE


@dataclass(frozen=True, slots=True)
class Board:
    """A flat checkerboard. Corners come row by row, columns fastest."""

    columns: int
    """Inner corners along x."""
    rows: int
    """Inner corners along y."""
    square: float
    """m, side of a square."""
    square_sigma: float | None = field(default=None, compare=False)
    """m, how well that is known: what is measured in metres is no surer. None: not stated, and SQUARE_SIDE of it; 0: exactly."""

    @property
    def count(self) -> int:
        return self.columns * self.rows

    @property
    def relative_sigma(self) -> float:
        """The standard deviation of everything's size, as the board gives it."""
        return SQUARE_SIDE.sigma if self.square_sigma is None else self.square_sigma / self.square

    def points(self) -> NDArray[np.float64]:
        """(count, 2) m, the corners in board coordinates: origin at the board's centre, x along columns, y along rows."""
        x = (np.arange(self.columns) - (self.columns - 1) / 2) * self.square
        y = (np.arange(self.rows) - (self.rows - 1) / 2) * self.square
        return np.stack(np.meshgrid(x, y, indexing="xy"), axis=-1).reshape(-1, 2)

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"

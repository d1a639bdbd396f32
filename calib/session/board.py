"""The board: how many corners, how far apart, where they are, and what tells them apart."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calib.session.coding import AprilGrid, Charuco, Coding
from calib.session.tolerances import SQUARE_SIDE


@dataclass(frozen=True, slots=True)
class Board:
    """A flat board. Its corners come row by row, columns fastest, from the upper left."""

    columns: int
    """Inner corners along x; of an AprilGrid two for each tag."""
    rows: int
    """The same along y."""
    square: float
    """m, side of a square, or of an AprilGrid's tag."""
    square_sigma: float | None = field(default=None, compare=False)
    """m, how well that is known: what is measured in metres is no surer.

    None: not stated, and SQUARE_SIDE of it; 0: exactly.
    """
    coding: Coding | None = None
    """None: a plain checkerboard, whose corners look alike."""

    @property
    def count(self) -> int:
        return self.columns * self.rows

    @property
    def relative_sigma(self) -> float:
        """The standard deviation of everything's size, as the board gives it."""
        return SQUARE_SIDE.sigma if self.square_sigma is None else self.square_sigma / self.square

    @property
    def part(self) -> str:
        """What has the side."""
        return "tag" if isinstance(self.coding, AprilGrid) else "square"

    @property
    def half(self) -> tuple[float, float]:
        """m, from the middle to the outermost corners along x and y."""
        return float(self._places(self.columns)[-1]), float(self._places(self.rows)[-1])

    def points(self) -> NDArray[np.float64]:
        """(count, 2) m, the corners in board coordinates: origin at the board's centre, x along
        columns, y along rows.
        """
        return np.stack(
            np.meshgrid(self._places(self.columns), self._places(self.rows), indexing="xy"), axis=-1
        ).reshape(-1, 2)

    def _places(self, count: int) -> NDArray[np.float64]:
        """(count,) m, along a row or a column."""
        match self.coding:
            case AprilGrid(spacing):
                places = np.add.outer(np.arange(count // 2) * (1 + spacing), (0.0, 1.0)).ravel()
                return np.asarray((places - places[-1] / 2) * self.square)
            case _:
                return np.asarray((np.arange(count) - (count - 1) / 2) * self.square)

    def __str__(self) -> str:
        match self.coding:
            case AprilGrid():
                return f"{self.columns // 2}x{self.rows // 2} AprilGrid"
            case Charuco():
                return f"{self.columns}x{self.rows} ChArUco"
            case None:
                return f"{self.columns}x{self.rows}"

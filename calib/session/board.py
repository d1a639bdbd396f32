"""The board: the number, spacing and positions of its corners, and the markers that identify
them.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calib.session.coding import AprilGrid, Charuco, Coding
from calib.session.tolerances import SQUARE_SIDE


@dataclass(frozen=True, slots=True)
class Board:
    """A flat board. Its corners come row by row, columns fastest, from the upper left."""

    columns: int
    """Inner corners along x; an AprilGrid has two for each tag."""
    rows: int
    """Inner corners along y."""
    square: float
    """m, the side of a square, or of an AprilGrid's tag."""
    square_sigma: float | None = field(default=None, compare=False)
    """m, the standard deviation of `square`, which limits the accuracy of everything in metres.

    None: not stated, then the tolerance SQUARE_SIDE applies; 0: exact.
    """
    coding: Coding | None = None
    """None: a plain checkerboard, whose corners look alike."""

    @property
    def has_grid(self) -> bool:
        """True if the corners lie in rows and columns."""
        return True

    @property
    def is_flat(self) -> bool:
        """True if all corners lie in the plane z = 0."""
        return True

    @property
    def across(self) -> int:
        """The number of corners along the longer side."""
        return max(self.columns, self.rows)

    @property
    def count(self) -> int:
        """The number of corners."""
        return self.columns * self.rows

    @property
    def relative_sigma(self) -> float:
        """The relative standard deviation of all sizes that follows from the board's."""
        return SQUARE_SIDE.sigma if self.square_sigma is None else self.square_sigma / self.square

    @property
    def cell(self) -> str:
        """The name of the shape whose side `square` is."""
        return "tag" if isinstance(self.coding, AprilGrid) else "square"

    @property
    def half(self) -> tuple[float, float]:
        """m, the distance from the middle to the outermost corners along x and y."""
        return float(self._places(self.columns)[-1]), float(self._places(self.rows)[-1])

    @property
    def marks(self) -> str:
        """The noun for its corners in a sentence."""
        return "corners"

    @property
    def views_words(self) -> str:
        """The words for further views of it in a sentence."""
        return "pictures of the board"

    @property
    def width(self) -> float:
        """m, the distance between the outermost corners along x or y, whichever is larger."""
        return 2 * max(self.half)

    def points(self) -> NDArray[np.float64]:
        """Return (count, 2) m, the corners in board coordinates. The origin is the board's centre,
        x runs along a row and y along a column.
        """
        return np.stack(
            np.meshgrid(self._places(self.columns), self._places(self.rows), indexing="xy"), axis=-1
        ).reshape(-1, 2)

    def points_in_space(self) -> NDArray[np.float64]:
        """Return (count, 3) m, the same with their z, which is 0 on a flat board."""
        points = self.points()
        return np.pad(points, ((0, 0), (0, 3 - points.shape[1])))

    def _places(self, count: int) -> NDArray[np.float64]:
        """Return (count,) m, the positions along a row or a column."""
        match self.coding:
            case AprilGrid(spacing):
                places = np.add.outer(np.arange(count // 2) * (1 + spacing), (0.0, 1.0)).ravel()
                return np.asarray((places - places[-1] / 2) * self.square)
            case _:
                return np.asarray((np.arange(count) - (count - 1) / 2) * self.square)

    def __str__(self) -> str:
        match self.coding:
            case AprilGrid(crossings=crossings):
                kind = "AprilGrid" if crossings else "GridBoard"
                return f"{self.columns // 2}x{self.rows // 2} {kind}"
            case Charuco():
                return f"{self.columns}x{self.rows} ChArUco"
            case None:
                return f"{self.columns}x{self.rows}"

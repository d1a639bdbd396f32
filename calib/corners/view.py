"""One picture's corners, wherever they came from: detection or a corners file; or why there are none."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The corners of one board, in one picture: row by row, columns fastest, as in `Board.points`."""

    name: str
    """The picture's file name."""
    corners: NDArray[np.float64]
    """(corners of the board, 2) px, NaN where not seen."""
    weight: NDArray[np.float64]
    """(corners of the board,) 1 for the best, smaller for a vaguer corner, 0 where not seen."""

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(corners of the board,) whether the corner was seen."""
        return self.weight > 0

    @property
    def count(self) -> int:
        """How many corners were seen."""
        return int(np.count_nonzero(self.weight > 0))


@dataclass(frozen=True, slots=True)
class Rejected:
    """A picture that is not used, and why. It is always listed, never dropped in silence."""

    name: str
    reason: str

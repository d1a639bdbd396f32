"""What a search of one picture ends with: a board's corners, or why there are none."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """A board in a picture."""

    corners: NDArray[np.float64]
    """(count, 2) px, row by row, columns fastest, of a checkerboard in the order of
    `canonical_order`; NaN where one was not found, or cannot be measured.
    """
    covariances: NDArray[np.float64]
    """(count, 2, 2) px^2, NaN likewise."""
    detector: Literal["saddles", "sb", "classic", "part", "coded"]
    twice: bool = False
    """Whether a second whole board of its kind was seen beside it: which one this is would be
    anybody's guess.
    """


@dataclass(frozen=True, slots=True)
class NotFound:
    """No board that could be used."""

    reason: str
    """To be said with the picture's name."""
    markers: Literal["none", "other", "own"] = "own"
    """Of a board with markers: whether hardly any was read, or those that were read may be another
    board's; `other_coding` then looks into that.
    """

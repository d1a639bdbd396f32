"""The result of a search in one picture: a board's corners, or the reason why there are none."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """A board in a picture."""

    corners: NDArray[np.float64]
    """(count, 2) px, row by row, columns fastest, for a checkerboard in the order of
    `canonical_order`; NaN where a corner is hidden or cannot be measured.
    """
    covariances: NDArray[np.float64]
    """(count, 2, 2) px^2; NaN where `corners` is NaN."""
    blurs: NDArray[np.float64]
    """(count, 2) px, as in `View.blur`; NaN where `corners` is NaN."""
    detector: Literal["saddles", "sb", "classic", "part", "coded"]
    ambiguous: bool = False
    """True if the picture shows a second whole board of this kind: nothing tells which of the two
    is meant.
    """


@dataclass(frozen=True, slots=True)
class NotFound:
    """The search found no board that can be used."""

    reason: str
    """A sentence to print after the picture's name."""
    markers: Literal["none", "other", "own"] = "own"
    """For a board with markers: "none" if hardly any marker was read, "other" if the markers may be
    another board's, which `other_coding` then investigates.
    """

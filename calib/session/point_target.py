"""A target of given points in place of a board, and the points of its views."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calib.session.board import Board
from calib.session.schema import Number, Quantity

CELLS = 10
"""A target of points has no squares: where a board's square is a measure of length, a tenth of the
target's size stands for it.
"""

PITCH = Quantity("pitch_mm", low=1e-3, high=100)
"""The pitch of a screen, from 1 um, a microscope's, to a wall of lamps."""


@dataclass(frozen=True, slots=True, eq=False)
class PointTarget(Board):
    """A flat target whose points come with each view, such as a screen. Its points are those of all
    views, one after the other, and no two views share one. Any two such targets are equal: they are
    taken for the same thing, seen at other points.
    """

    places: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    """(count, 2) m, the points on the target."""
    pitch: Number | None = None
    """m, from pixel to pixel of the screen that the points lie on. None: not stated."""

    @staticmethod
    def of(places: NDArray[np.float64], pitch: Number | None = None) -> "PointTarget":
        """Return the target of (count, 2) m points on it."""
        size = 2 * float(np.abs(places).max(initial=1e-9))
        square = size / CELLS
        is_stated = pitch is not None and (pitch.exact or pitch.sigma > 0)
        sigma = square * pitch.sigma / pitch.value if pitch and is_stated else None
        return PointTarget(len(places), 1, square, sigma, places=places, pitch=pitch)

    @property
    def has_grid(self) -> bool:
        """False: its points lie anywhere."""
        return False

    @property
    def across(self) -> int:
        """The number of points along a side if they filled a square."""
        return int(np.ceil(self.count**0.5))

    @property
    def half(self) -> tuple[float, float]:
        """m, the distance from the origin to the outermost points along x and y."""
        x, y = np.abs(self.places).max(0, initial=1e-9)
        return float(x), float(y)

    @property
    def width(self) -> float:
        """m, the extent of the points along x or y, whichever is larger."""
        return float(np.ptp(self.places, axis=0).max()) if self.count else 0.0

    def points(self) -> NDArray[np.float64]:
        """Return (count, 2) m, the points on the target."""
        return self.places

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PointTarget)

    def __hash__(self) -> int:
        return hash(PointTarget)

    def __str__(self) -> str:
        return f"{self.count} points"


@dataclass(frozen=True, slots=True, eq=False)
class PointView:
    """The points of one view."""

    name: str
    """The file's name."""
    pixels: NDArray[np.float64]
    """(N, 2) px"""
    places: NDArray[np.float64]
    """(N, 2) m on the target."""
    covariance: NDArray[np.float64]
    """(N, 2, 2) px^2"""

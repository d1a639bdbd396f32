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

SMALLEST = 1e-9
"""m, the size of a target without points, or with all of them at one place."""

FAR_ORIGIN = 4.0
"""Sizes of a target from its origin to its middle, above which the origin is moved. Below it, views
of a small piece of a screen keep the screen's origin.
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
        size = float(np.ptp(places, axis=0).max()) if len(places) else 0.0
        square = max(size, SMALLEST) / CELLS
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
    def marks(self) -> str:
        """The noun for its points in a sentence."""
        return "points"

    @property
    def views_words(self) -> str:
        """The words for further views of it in a sentence."""
        return "views of the target"

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


def near_origin(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (count, 2) m points moved so that the origin is near them, where it is far away: a
    pose turns the target about its origin, and its shape is a polynomial about it. The move is a
    multiple of the next power of two above the target's size, so that later points of the same
    target, which have about the same size and middle, move alike.
    """
    if not len(places):
        return places
    step = 2.0 ** np.ceil(np.log2(max(float(np.ptp(places, axis=0).max()), SMALLEST)))
    steps = (places.min(0) + places.max(0)) / 2 / step
    return places - step * np.round(steps) if np.abs(steps).max() > FAR_ORIGIN else places


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

"""A target of given points in place of a board, and the points of its views."""

from collections.abc import Sequence
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
    """A target whose points come with each view, such as a screen or the marker of a robot. Its
    points are those of all views, one after the other, and no two views share one. Any two flat
    targets are equal: they are taken for the same thing, seen at other points. So are any two that
    are not flat.
    """

    places: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    """(count, 2) m, the points on a flat target, or (count, 3) m."""
    pitch: Number | None = None
    """m, from pixel to pixel of the screen that the points lie on. None: not stated."""

    @staticmethod
    def of(places: NDArray[np.float64], pitch: Number | None = None) -> "PointTarget":
        """Return the target of (count, 2) m points on a plane, or of (count, 3) m points."""
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
    def is_flat(self) -> bool:
        """True if all points lie in the plane z = 0, so that they have no z."""
        return bool(self.places.shape[1] == 2)

    @property
    def across(self) -> int:
        """The number of points along a side if they filled a square."""
        return int(np.ceil(self.count**0.5))

    @property
    def half(self) -> tuple[float, float]:
        """m, the distance from the origin to the outermost points along x and y."""
        x, y, *_ = np.abs(self.places).max(0, initial=1e-9).tolist()
        return x, y

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
        """m, the extent of the points along the axis where it is largest."""
        return float(np.ptp(self.places, axis=0).max()) if self.count else 0.0

    def points(self) -> NDArray[np.float64]:
        """Return (count, 2) m, the points of a flat target, or (count, 3) m."""
        return self.places

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PointTarget) and other.is_flat == self.is_flat

    def __hash__(self) -> int:
        return hash(PointTarget)

    def __str__(self) -> str:
        return f"{self.count} points"


def in_space(board: Board) -> Board:
    """Return a flat target of points as a part of one that is not flat, and a board as it is."""
    if not isinstance(board, PointTarget):
        return board
    return PointTarget.of(board.points_in_space(), board.pitch)


def near_origin(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (count, 2 or 3) m points moved so that the origin is near them, where it is far away:
    a pose turns the target about its origin, and its shape is a polynomial about it. The move is a
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
    """(N, 2) m on the target if all have z = 0, else (N, 3) m."""
    covariance: NDArray[np.float64]
    """(N, 2, 2) px^2"""


def join_places(views: Sequence[PointView]) -> NDArray[np.float64]:
    """Return the points of all views, one after the other: (count, 2) m if all have z = 0, else
    (count, 3) m.
    """
    width = max((view.places.shape[1] for view in views), default=2)
    columns = [np.pad(p, ((0, 0), (0, width - p.shape[1]))) for p in (v.places for v in views)]
    return np.concatenate([np.zeros((0, width)), *columns])

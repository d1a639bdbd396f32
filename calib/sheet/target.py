"""The printed part of a board: filled polygons, and the positions of its corners."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

Point = tuple[float, float]
"""mm, x to the right and y down."""

Polygon = tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class PatternDrawing:
    """A drawing of `Pattern.extent` times the side; its origin is the upper left."""

    polygons: tuple[Polygon, ...]
    """Black areas. They may touch, but they do not overlap."""
    corners: tuple[Point, ...]
    """The corners that a detector finds, in the order of the session's board."""


class Pattern(Protocol):
    """A kind of board, drawn at any size."""

    @property
    def extent(self) -> tuple[float, float]:
        """Width and height, in sides."""

    @property
    def title(self) -> str:
        """The description that the sheet shows."""

    @property
    def cell(self) -> str:
        """The name of the shape that has the side: a square, a tag."""

    def draw(self, side: float) -> PatternDrawing:
        """Draw the board with squares or tags of this side, mm."""

    def to_yaml(self, side: float, entry: object) -> Mapping[str, object]:
        """Return the section `board` of session.yaml for a side in mm, with `entry` in place of the
        side.
        """


def rectangle(x: float, y: float, width: float, height: float) -> Polygon:
    """Return a rectangle, clockwise from its upper left, mm."""
    return (x, y), (x + width, y), (x + width, y + height), (x, y + height)

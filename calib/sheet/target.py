"""What is printed of a target: filled polygons, and where its corners are."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

Point = tuple[float, float]
"""x to the right and y down, mm."""

Polygon = tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Target:
    """A drawing of `Pattern.extent` times the side, its origin at the upper left."""

    polygons: tuple[Polygon, ...]
    """Black; they may touch, but do not overlap."""
    corners: tuple[Point, ...]
    """What a detector finds, in the order of the session's board."""


class Pattern(Protocol):
    """A target of any size: a kind of board, and all that is said of it but the side of its squares."""

    @property
    def extent(self) -> tuple[float, float]:
        """Width and height, in sides."""

    @property
    def title(self) -> str:
        """What it is, in words."""

    def draw(self, side: float) -> Target:
        """With squares of this side, mm."""

    def to_yaml(self, side: object) -> Mapping[str, object]:
        """The section `board` of session.yaml, whose side is written as given."""


def square(x: float, y: float, side: float) -> Polygon:
    """Clockwise from its upper left, mm."""
    return (x, y), (x + side, y), (x + side, y + side), (x, y + side)

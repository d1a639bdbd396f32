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
    """A target of any size: a kind of board, and all that is said of it but the side of its
    parts.
    """

    @property
    def extent(self) -> tuple[float, float]:
        """Width and height, in sides."""

    @property
    def title(self) -> str:
        """What it is, in words."""

    @property
    def part(self) -> str:
        """What has the side: a square, a tag."""

    def draw(self, side: float) -> Target:
        """With squares or tags of this side, mm."""

    def to_yaml(self, side: float, entry: object) -> Mapping[str, object]:
        """The section `board` of session.yaml for a side in mm, with `entry` in the place of the
        side.
        """


def rectangle(x: float, y: float, width: float, height: float) -> Polygon:
    """Clockwise from its upper left, mm."""
    return (x, y), (x + width, y), (x + width, y + height), (x, y + height)

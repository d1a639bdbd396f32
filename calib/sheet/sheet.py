"""A sheet of paper to print: shapes and words in mm from its upper left, y down.

`pdf.py` and `svg.py` write it.
"""

from dataclasses import dataclass

from calib.sheet.paper import Paper
from calib.sheet.target import Point, Polygon

DIGIT = 0.556
"""The width of a digit in font sizes, in Helvetica and in the fonts with its metrics."""


@dataclass(frozen=True, slots=True)
class LineSegment:
    """A straight line."""

    start: Point
    end: Point
    width: float
    """mm"""


@dataclass(frozen=True, slots=True)
class Text:
    """One line of Helvetica."""

    place: Point
    """The start of its baseline, mm."""
    size: float
    """mm"""
    words: str
    bold: bool = False
    upwards: bool = False
    """True if it is rotated by 90 degrees to the left."""


@dataclass(frozen=True, slots=True)
class Sheet:
    """A sheet with a board, two rulers and the words below."""

    title: str
    paper: Paper
    side: float
    """mm, the side of a square or a tag."""
    white: float
    """mm, the width of the narrowest free strip around the board."""
    rulers: tuple[int, int]
    """mm, the lengths of the rulers along x and y."""
    polygons: tuple[Polygon, ...]
    corners: tuple[Point, ...]
    """The corners that a detector finds, mm."""
    lines: tuple[LineSegment, ...]
    texts: tuple[Text, ...]


def decimal(value: float) -> str:
    """Return the number to 0.1 um, without zeros at the end, as both files have it."""
    return f"{round(value, 4) + 0.0:.4f}".rstrip("0").rstrip(
        "."
    )  # adding 0.0 removes the sign of -0

"""A sheet of paper as it is to be printed: shapes and words in mm from its upper left, y down.

`pdf.py` and `svg.py` write it.
"""

from dataclasses import dataclass

from calib.sheet.paper import Paper
from calib.sheet.target import Point, Polygon

DIGIT = 0.556
"""Of the font's size: how wide a digit is in Helvetica, and in the fonts made to its measure."""


@dataclass(frozen=True, slots=True)
class Line:
    start: Point
    end: Point
    width: float
    """mm"""


@dataclass(frozen=True, slots=True)
class Text:
    """One line of Helvetica."""

    place: Point
    """Where its baseline begins."""
    size: float
    """mm"""
    words: str
    bold: bool = False
    upwards: bool = False
    """Turned to the left by 90 degrees."""


@dataclass(frozen=True, slots=True)
class Sheet:
    title: str
    paper: Paper
    side: float
    """mm, of a square or a tag."""
    white: float
    """mm, the least that is left free around the board."""
    rulers: tuple[int, int]
    """mm, how long they are, along x and along y."""
    polygons: tuple[Polygon, ...]
    corners: tuple[Point, ...]
    """Where the detector is to find them."""
    lines: tuple[Line, ...]
    texts: tuple[Text, ...]


def decimal(value: float) -> str:
    """To 0.1 um, without zeros at the end: what both files have."""
    return f"{round(value, 4) + 0.0:.4f}".rstrip("0").rstrip(".")  # 0.0 takes the sign from -0

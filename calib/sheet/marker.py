"""Draw square markers of OpenCV's dictionaries."""

from collections.abc import Iterator
from itertools import groupby

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.sheet.target import Polygon, rectangle


def draw_marker_cells(name: str, number: int, border: int) -> NDArray[np.bool_]:
    """Return (cells, cells), true where marker `number` of the dictionary, such as DICT_4X4_50, is
    black; its border is `border` cells wide.
    """
    dictionary = _dictionary(name)
    cells = dictionary.markerSize + 2 * border
    return np.asarray(dictionary.generateImageMarker(number, cells, None, border) == 0)


def black_rectangles(
    cells: NDArray[np.bool_], x: float, y: float, side: float
) -> Iterator[Polygon]:
    """Yield the black runs of each row, for a marker of this side (mm) whose upper left is at x,
    y.
    """
    cell = side / len(cells)
    for row, line in enumerate(cells):
        for black, run in groupby(range(len(line)), key=lambda column: bool(line[column])):
            columns = list(run)
            if black:
                yield rectangle(x + columns[0] * cell, y + row * cell, len(columns) * cell, cell)


def check_marker_count(name: str, needed: int) -> None:
    """Raise InputError if a dictionary has fewer markers than a board needs."""
    available = len(_dictionary(name).bytesList)
    if needed > available:
        raise InputError(
            f"the board needs {needed} markers where {name} has {available}: take fewer columns or"
            " rows, or another dictionary."
        )


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))

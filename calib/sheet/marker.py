"""The black of a square marker, whose dictionary is one of OpenCV's."""

from collections.abc import Iterator
from itertools import groupby

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.sheet.target import Polygon, rectangle


def black_bits(name: str, number: int, border: int) -> NDArray[np.bool_]:
    """(cells, cells), of marker `number` of the dictionary, such as DICT_4X4_50, with a black
    border of so many cells.
    """
    dictionary = _dictionary(name)
    cells = dictionary.markerSize + 2 * border
    return np.asarray(dictionary.generateImageMarker(number, cells, None, border) == 0)


def black_of(bits: NDArray[np.bool_], x: float, y: float, side: float) -> Iterator[Polygon]:
    """The black runs of each row, in a marker of this side (mm) whose upper left is x, y."""
    cell = side / len(bits)
    for row, line in enumerate(bits):
        for black, run in groupby(range(len(line)), key=lambda column: bool(line[column])):
            columns = list(run)
            if black:
                yield rectangle(x + columns[0] * cell, y + row * cell, len(columns) * cell, cell)


def check_count(name: str, needed: int) -> None:
    """InputError where a dictionary has fewer markers than a board needs."""
    there = len(_dictionary(name).bytesList)
    if needed > there:
        raise InputError(
            f"the board needs {needed} markers where {name} has {there}: take fewer columns or"
            " rows, or another dictionary."
        )


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))

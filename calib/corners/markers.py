"""The markers of a picture by OpenCV's aruco module, and where on a board each one is."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.reduced import enlarged
from calib.errors import InputError
from calib.session.board import Board
from calib.session.coding import AprilGrid, Charuco, Coding

Floats = NDArray[np.float64]

BORDERS = {Charuco: 1, AprilGrid: 2}
"""Cells of black around a marker's bits: Kalibr's have one more than others."""


@dataclass(frozen=True, slots=True, eq=False)
class Markers:
    """M markers that were read, rightly or wrongly; a number may come twice."""

    numbers: NDArray[np.int64]
    """(M,)"""
    corners: Floats
    """(M, 4, 2) px, clockwise from the upper left of the marker as its dictionary has it."""

    def some(self, which: NDArray) -> "Markers":
        return Markers(self.numbers[which], self.corners[which])

    @property
    def sides(self) -> Floats:
        """(M,) px, in the mean."""
        return np.asarray(
            np.linalg.norm(self.corners - np.roll(self.corners, 1, 1), axis=-1).mean(1)
        )


WINDOWS_TRIED = (3, 13, 23)
"""px, OpenCV's own: each threshold costs a third of the time, and is needed where markers touch
other black, as Kalibr's do.
"""

CLOSE = 3.3  # px of a cell: with smaller ones, a second look is taken
ENLARGED = 2
SHARPENED = 1.0  # of what a blur of SHARPENED_OVER px removes from the enlarged picture
SHARPENED_OVER = 2.0


def read_markers(
    grey: NDArray[np.uint8], dictionary: str, border: int, windows: tuple[int, ...] = WINDOWS_TRIED
) -> Markers:
    """Of a (H, W) picture.

    `windows` are the sides (px) over which the adaptive threshold is taken, equally far apart.
    """
    check_aruco()
    options = cv2.aruco.DetectorParameters()
    options.markerBorderBits = border
    options.adaptiveThreshWinSizeMin, options.adaptiveThreshWinSizeMax = windows[0], windows[-1]
    options.adaptiveThreshWinSizeStep = windows[1] - windows[0] if len(windows) > 1 else 1
    corners, numbers, _ = cv2.aruco.ArucoDetector(_dictionary(dictionary), options).detectMarkers(
        grey
    )
    if numbers is None or not len(corners):
        return Markers(np.zeros(0, np.int64), np.zeros((0, 4, 2)))
    return Markers(
        np.asarray(numbers, np.int64).ravel(), np.asarray(corners, np.float64).reshape(-1, 4, 2)
    )


def read_closely(
    grey: NDArray[np.uint8], coding: Coding, windows: tuple[int, ...] = WINDOWS_TRIED
) -> Markers:
    """The same, and where their cells are small, those of the picture enlarged and sharpened, too:
    of cells of 2.5 px hardly any marker is read in the picture as it is. Where none is, it is out
    of focus, or there is no board, and nothing is enlarged.
    """
    border = border_of(coding)
    read = read_markers(grey, coding.dictionary, border, windows)
    if not len(read.numbers) or np.median(read.sides) >= CLOSE * marker_cells(coding):
        return read
    large = cv2.resize(grey, None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_CUBIC)
    sharp = cv2.addWeighted(
        large, 1 + SHARPENED, cv2.GaussianBlur(large, (0, 0), SHARPENED_OVER), -SHARPENED, 0
    )
    again = read_markers(np.asarray(sharp, np.uint8), coding.dictionary, border)
    again = Markers(again.numbers, enlarged(again.corners, 1 / ENLARGED))
    return _joined(read, again)


def _joined(read: Markers, again: Markers) -> Markers:
    """Those of the first, and of the second what is not one of these at its place."""
    apart = np.linalg.norm(again.corners.mean(1)[:, None] - read.corners.mean(1), axis=-1)
    same = (again.numbers[:, None] == read.numbers) & (apart < again.sides[:, None] / 2)
    new = again.some(~same.any(1))
    return Markers(
        np.concatenate([read.numbers, new.numbers]), np.concatenate([read.corners, new.corners])
    )


def border_of(coding: Coding) -> int:
    return BORDERS[type(coding)]


def marker_cells(coding: Coding) -> int:
    """Along a side of a marker, with its border."""
    return size_of_markers(coding.dictionary, border_of(coding))


def size_of_markers(dictionary: str, border: int) -> int:
    """Cells along a side, with a border of so many."""
    return int(_dictionary(dictionary).markerSize) + 2 * border


def black_cells(dictionary: str, number: int, border: int) -> NDArray[np.bool_]:
    """(n, n) of a marker, as its dictionary has it."""
    cells = size_of_markers(dictionary, border)
    return np.asarray(
        _dictionary(dictionary).generateImageMarker(number, cells, borderBits=border) == 0
    )


@lru_cache(64)
def marker_places(board: Board) -> Floats:
    """(markers, 4, 2) m, where the corners of each are on the board, in the order of
    `Markers.corners`.
    """
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    match board.coding:
        case AprilGrid(spacing):
            columns, rows = board.columns // 2, board.rows // 2
            column, row = np.meshgrid(
                np.arange(columns), np.arange(rows)[::-1]
            )  # numbered from the lower left
            first = (
                np.stack([column, row], -1).reshape(-1, 1, 2) * (1 + spacing) * board.square
                - board.half
            )
            return np.asarray(
                first + square[[2, 3, 0, 1]] * board.square
            )  # OpenCV has the family upside down
        case Charuco(marker, _, legacy_pattern):
            column, row = np.meshgrid(np.arange(board.columns + 1), np.arange(board.rows + 1))
            white = (column + row + (legacy_pattern and board.rows % 2 == 1)) % 2 == 1
            middles = (np.stack([column, row], -1)[white] - 0.5) * board.square - board.half
            return np.asarray(middles[:, None] + (square - 0.5) * marker)
        case None:
            raise ValueError("a checkerboard has no markers")


def check_aruco() -> None:
    if not hasattr(cv2, "aruco") or not hasattr(cv2.aruco, "ArucoDetector"):
        raise InputError(
            f"OpenCV {cv2.__version__} here has no aruco module, which reads markers: install"
            " opencv-python-headless."
        )


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))

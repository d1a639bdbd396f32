"""Read the markers of a picture with OpenCV's aruco module, and place them on the board."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.picture_scale import enlarge_corners
from calib.errors import InputError
from calib.session.board import Board
from calib.session.coding import AprilGrid, Charuco, Coding

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Markers:
    """M markers that were read, rightly or wrongly. A number may occur more than once."""

    numbers: NDArray[np.int64]
    """(M,)"""
    corners: Floats
    """(M, 4, 2) px, clockwise from the marker's upper left corner in its dictionary."""

    def select(self, index: NDArray) -> "Markers":
        """Return the markers at (K,) indices, or where an (M,) mask is true."""
        return Markers(self.numbers[index], self.corners[index])

    @property
    def sides(self) -> Floats:
        """(M,) px, the mean length of each marker's four sides."""
        return np.asarray(
            np.linalg.norm(self.corners - np.roll(self.corners, 1, 1), axis=-1).mean(1)
        )


THRESHOLD_WINDOWS = (3, 13, 23)
"""px, OpenCV's defaults. Each threshold costs a third of the time, and is needed where markers
touch other black, as Kalibr's do.
"""

SMALL_CELL = 3.3  # px: smaller cells are read in the enlarged picture, too
ENLARGEMENT = 2
SHARPENING = 1.0  # of what a blur of SHARPENING_BLUR px removes from the enlarged picture
SHARPENING_BLUR = 2.0


def read_markers(
    grey: NDArray[np.uint8],
    dictionary: str,
    border: int,
    windows: tuple[int, ...] = THRESHOLD_WINDOWS,
) -> Markers:
    """Read the markers of a (H, W) picture.

    Args:
        grey: (H, W).
        dictionary: OpenCV's name of it.
        border: cells of black around the bits.
        windows: px, the equally spaced sides of the adaptive threshold's windows.
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


def read_small_markers(
    grey: NDArray[np.uint8], coding: Coding, windows: tuple[int, ...] = THRESHOLD_WINDOWS
) -> Markers:
    """Read the markers of a (H, W) picture, and if their cells are small, those of the enlarged and
    sharpened picture, too.

    With cells of 2.5 px hardly any marker can be read in the picture as it is. If no marker at all
    is read, the picture is out of focus or shows no board, and nothing is enlarged.
    """
    border = border_of(coding)
    markers = read_markers(grey, coding.dictionary, border, windows)
    if not len(markers.numbers) or np.median(markers.sides) >= SMALL_CELL * marker_cells(coding):
        return markers
    large = cv2.resize(grey, None, fx=ENLARGEMENT, fy=ENLARGEMENT, interpolation=cv2.INTER_CUBIC)
    sharp = cv2.addWeighted(
        large, 1 + SHARPENING, cv2.GaussianBlur(large, (0, 0), SHARPENING_BLUR), -SHARPENING, 0
    )
    enlarged_markers = read_markers(np.asarray(sharp, np.uint8), coding.dictionary, border)
    enlarged_markers = Markers(
        enlarged_markers.numbers, enlarge_corners(enlarged_markers.corners, 1 / ENLARGEMENT)
    )
    return _merge_markers(markers, enlarged_markers)


def _merge_markers(markers: Markers, candidates: Markers) -> Markers:
    """Return the markers and those candidates that do not repeat one of them at its place."""
    distance = np.linalg.norm(
        candidates.corners.mean(1)[:, None] - markers.corners.mean(1), axis=-1
    )
    same = (candidates.numbers[:, None] == markers.numbers) & (
        distance < candidates.sides[:, None] / 2
    )
    new = candidates.select(~same.any(1))
    return Markers(
        np.concatenate([markers.numbers, new.numbers]),
        np.concatenate([markers.corners, new.corners]),
    )


def border_of(coding: Coding) -> int:
    """Return how many cells of black surround a marker's bits."""
    return coding.border


def marker_cells(coding: Coding) -> int:
    """Return the number of cells along a marker's side, with its border."""
    return size_of_markers(coding.dictionary, border_of(coding))


def size_of_markers(dictionary: str, border: int) -> int:
    """Return the number of cells along a side, with a border of `border` cells."""
    return int(_dictionary(dictionary).markerSize) + 2 * border


def black_cells(dictionary: str, number: int, border: int) -> NDArray[np.bool_]:
    """Return (n, n), true where the marker of this number is black, with its border."""
    cells = size_of_markers(dictionary, border)
    return np.asarray(
        _dictionary(dictionary).generateImageMarker(number, cells, borderBits=border) == 0
    )


@lru_cache(64)
def marker_places(board: Board) -> Floats:
    """Return (markers, 4, 2) m, the corners of each marker on the board, in the order of
    `Markers.corners`. The first is the board's first marker, whatever its number.
    """
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    match board.coding:
        case AprilGrid(spacing, numbered_from=numbered_from, rotation_deg=rotation_deg):
            columns, rows = board.columns // 2, board.rows // 2
            downwards = 1 if numbered_from == "upper_left" else -1
            column, row = np.meshgrid(np.arange(columns), np.arange(rows)[::downwards])
            first = (
                np.stack([column, row], -1).reshape(-1, 1, 2) * (1 + spacing) * board.square
                - board.half
            )
            return np.asarray(first + np.roll(square, -rotation_deg // 90, 0) * board.square)
        case Charuco(marker, _, legacy_pattern):
            column, row = np.meshgrid(np.arange(board.columns + 1), np.arange(board.rows + 1))
            white = (column + row + (legacy_pattern and board.rows % 2 == 1)) % 2 == 1
            middles = (np.stack([column, row], -1)[white] - 0.5) * board.square - board.half
            return np.asarray(middles[:, None] + (square - 0.5) * marker)
        case None:
            raise ValueError("a checkerboard has no markers")


def check_aruco() -> None:
    """Raise InputError if the installed OpenCV cannot read markers."""
    if not hasattr(cv2, "aruco") or not hasattr(cv2.aruco, "ArucoDetector"):
        raise InputError(
            f"OpenCV {cv2.__version__} here has no aruco module, which reads markers: install"
            " opencv-python-headless."
        )


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))

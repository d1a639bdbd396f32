"""One picture -> the corners of a board with markers, of as much of it as the picture shows.

Markers say which corners are where, to a pixel; what a corner is measured by is its own edges, as on a checkerboard. OpenCV's own way from
markers to a ChArUco's corners is not taken: before its version 5 they come out half a pixel off.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.detection import Detection, NotFound
from calib.corners.local_map import LocalMap
from calib.corners.marker_links import Links
from calib.corners.markers import Markers, border_of, marker_places, read_markers
from calib.corners.measure import measure
from calib.session.board import Board
from calib.session.coding import AprilGrid, Charuco

Floats = NDArray[np.float64]

ADVICE = "show more of it, sharp, evenly lit and larger"
NOISE = 1.0  # px, of a marker's corners
AROUND = 1.35  # sides: how far from a marker's corner others are looked for
BORDER = 3.0  # px of the picture, where no corner is measured
WINDOWS = (2, 10)  # px, cornerSubPix's half-size
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
STRAY = 0.1  # of the distance of two corners, and at least a pixel: how far one may be from where the others around it say
FEWEST = 4
"""Corners around which others are judged."""


def find_coded(grey: NDArray[np.uint8], every_bit: NDArray, board: Board) -> Detection | NotFound:
    """In a (H, W) picture: `grey` is looked at, `every_bit`, uint8 or uint16, measured."""
    assert board.coding
    read = read_markers(grey, board.coding.dictionary, border_of(board.coding))
    own = one_board(read, board)
    if isinstance(own, NotFound):
        return own
    rough = _refined(grey, *_predicted(own, board, grey.shape))
    if np.isfinite(rough[:, 0]).sum() < FEWEST:
        return NotFound(f"hardly any corner of the {board} board can be seen: {ADVICE}")
    measured = measure(every_bit, rough, board)
    stray = _strays(measured.corners, board)
    corners, covariances = measured.corners.copy(), measured.covariances.copy()
    corners[stray], covariances[stray] = np.nan, np.nan
    return Detection(corners, covariances, "coded")


def one_board(read: Markers, board: Board) -> Markers | NotFound:
    """Those of the markers that lie as on the board; or why they are not to be trusted."""
    places = marker_places(board)
    known = read.some((read.numbers >= 0) & (read.numbers < len(places)))
    foreign = len(read.numbers) - len(known.numbers)
    if foreign >= max(3, len(known.numbers) / 5):
        return NotFound(
            f"markers with numbers up to {read.numbers.max()} are seen, where a {board} board has 0 to {len(places) - 1}: correct columns, "
            "rows or dictionary in session.yaml, or show this board alone"
        )
    if not len(known.numbers):
        return NotFound(f"no marker of the {board} board found: {ADVICE}")
    groups = Links.of(known, places[known.numbers], _pitch(board)).groups
    if len(groups[0]) < 2:
        return NotFound(f"no two markers lie as on the {board} board: {ADVICE}, or correct board in session.yaml")
    twice = _twice(known)
    if twice is not None:
        return NotFound(f"marker {twice} of the {board} board is seen twice: show one board alone, with each of its markers once")
    if len(groups) > 1 and len(groups[1]) > 1:
        return NotFound(f"the markers lie not as on one {board} board: correct board in session.yaml, or show one board alone")
    return known.some(groups[0])


def _pitch(board: Board) -> float:
    """m, between neighbouring markers."""
    match board.coding:
        case AprilGrid(spacing):
            return (1 + spacing) * board.square
        case _:
            return 2**0.5 * board.square


def _twice(markers: Markers) -> int | None:
    """A number that is read at two places."""
    for number in np.unique(markers.numbers):
        same = markers.some(markers.numbers == number)
        middles = same.corners.mean(1)
        if (np.linalg.norm(middles - middles[0], axis=-1) > same.sides.min() / 2).any():
            return int(number)
    return None


def _predicted(markers: Markers, board: Board, shape: tuple[int, ...]) -> tuple[Floats, Floats]:
    """(count, 2) px where the board's corners are to be looked for, NaN where nothing says, and (count,) px of their surroundings that are
    free of other edges."""
    known = marker_places(board)[markers.numbers].reshape(-1, 2)
    points = board.points()
    unit = 2 * board.half[0] / (board.columns - 1)
    near = LocalMap.of(known / unit, markers.corners.reshape(-1, 2), points / unit, NOISE)
    told = np.linalg.norm(points[:, None] - known[None], axis=-1).min(1) <= AROUND * board.square
    inside = ((near.pixels >= BORDER) & (near.pixels <= np.array(shape[::-1]) - 1 - BORDER)).all(1)
    free = np.linalg.norm(near.steps, axis=-1).min(1) * _free(board) / unit
    return np.where((told & inside)[:, None], near.pixels, np.nan), free


def _free(board: Board) -> float:
    """m, around a corner, that show its own two edges alone."""
    match board.coding:
        case Charuco(marker):
            return (board.square - marker) / 2
        case AprilGrid(spacing):
            return min(spacing, 0.2) * board.square
        case None:
            return board.square / 2


def _refined(grey: NDArray[np.uint8], rough: Floats, free: Floats) -> Floats:
    """By cornerSubPix; NaN where that leads away."""
    found = np.full_like(rough, np.nan)
    halves = np.clip(np.nan_to_num(free), *WINDOWS).astype(int)
    for half in np.unique(halves):
        own = np.flatnonzero((halves == half) & np.isfinite(rough[:, 0]))
        if not len(own):
            continue
        start = rough[own].reshape(-1, 1, 2).astype(np.float32)
        moved = np.asarray(cv2.cornerSubPix(grey, start, (int(half), int(half)), (-1, -1), STOP), np.float64).reshape(-1, 2)
        stays = np.linalg.norm(moved - rough[own], axis=1) <= half + 1
        found[own[stays]] = moved[stays]
    return found


def _strays(corners: Floats, board: Board) -> NDArray[np.bool_]:
    """(count,) whether a corner is not where those around it say."""
    seen = np.flatnonzero(np.isfinite(corners[:, 0]))
    unit = 2 * board.half[0] / (board.columns - 1)
    points = board.points()[seen] / unit
    near = LocalMap.of(points, corners[seen], points, 0.1)
    off = np.linalg.norm(near.pixels - corners[seen], axis=1)
    stray = np.zeros(len(corners), bool)
    stray[seen] = off > np.maximum(STRAY * np.linalg.norm(near.steps, axis=-1).min(1), 1)
    return stray

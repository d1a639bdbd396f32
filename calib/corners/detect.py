"""Find the corners of one checkerboard in a picture, to a few hundredths of a pixel and better.

The crossings of a whole board's edges identify its corners in 8 ms (`calib.corners.saddle_grid`, as
in the live picture). cornerSubPix then locates them to hundredths of a pixel, and a fit of every
corner's patch measures them (`calib.corners.measure`). Boards that are not found in this way are
searched by the sector detector (SB, 50 ms in a reduced picture), and those that it misses or gets
wrong by the classic one. SB's own corners, on rendered views of known truth, are off by 0.04 px, by
0.1 where the squares are small and by 0.2 where the board is tilted by 50 degrees, all in one
direction in a view. That holds with CALIB_CB_EXHAUSTIVE and CALIB_CB_ACCURACY, at 2 s a picture;
CALIB_CB_NORMALIZE_IMAGE doubles it. cornerSubPix on a smoothed picture leaves 0.03 px, without a
common direction, and the patches leave 0.012.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from calib.corners.detection import Detection
from calib.corners.measure import measure_corners
from calib.corners.ordering import canonical_order
from calib.corners.picture_scale import enlarge_corners, reduce_picture, reducing_factor
from calib.corners.saddle_grid import SaddleGrid, find_grid
from calib.session.board import Board

VERSION = 10
"""Raise it with every change that moves corners: stored detections are then made again."""

SEED = 0
"""SB's search trees draw from the thread's random numbers. Without a fixed seed, a partly hidden
board would get other corners after other pictures. (0 is OpenCV's own start.)
"""
MAX_SIDE = 800  # px, the longer side of the reduced picture
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
# of the spacing, how far a corner may lie from the middle of its neighbours: perspective and lenses
# stay below 0.2
MAX_BEND = 0.3
# of the spacing, how much that offset may change between neighbours: a skipped row makes 0.6
MAX_KINK = 0.15
SECTOR_FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE
QUAD_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE

REFINEMENT_SCALE = 2
"""cornerSubPix interpolates linearly, which pulls corners towards pixel borders by 0.01 to 0.02 px;
on a picture enlarged by cubic splines it does not.
"""


@dataclass(frozen=True, slots=True, eq=False)
class CornerGrid:
    """A chessboard of unknown size in a picture."""

    size: tuple[int, int]
    """(columns, rows), with at least as many columns as rows."""
    corners: NDArray[np.float64]
    """(columns * rows, 2) px, roughly located; row by row, columns fastest."""


@dataclass(frozen=True, slots=True, eq=False)
class LocatedBoard:
    """The corners of a board as a search locates them, before they are refined."""

    corners: NDArray[np.float64]
    """(count, 2) px, wrong by some pixels at worst."""
    ambiguous: bool = False
    """True if the search found a second board."""


def find_corners(grey: NDArray, board: Board) -> Detection | None:
    """Return the board's corners in a (H, W) uint8 or uint16 picture; None where the board is not
    wholly and clearly visible.
    """
    every_bit = grey
    grey = eight_bits(every_bit)
    for detector, search in SEARCHES:
        located = search(grey, board)
        # SB's corners may be pixels off: only refined ones are judged
        if located and is_inside(located.corners, grey.shape):
            corners = refine(grey, located.corners, board)
            if is_regular(corners, board, grey.shape):
                measured = measure_corners(every_bit, canonical_order(grey, corners, board), board)
                return Detection(
                    measured.corners,
                    measured.covariances,
                    measured.blurs,
                    detector,
                    located.ambiguous,
                )
    return None


def shows_two(grid: SaddleGrid, board: Board) -> bool:
    """True if a second whole board of this kind is visible beside the first."""
    positions = grid.runner_up.board_positions(board) if grid.runner_up else ()
    return any(
        is_smooth_grid(corners.reshape(board.rows, board.columns, 2)) for corners in positions
    )


def largest_grid(grey: NDArray) -> CornerGrid | None:
    """Return the largest chessboard in a (H, W) uint8 picture, whatever its size; where the rest is
    hidden, a part of a board.
    """
    small, scale = _reduce(grey)
    cv2.setRNGSeed(SEED)
    is_found, corners, meta = cv2.findChessboardCornersSBWithMeta(
        small, (3, 3), SECTOR_FLAGS | cv2.CALIB_CB_LARGER
    )
    if not is_found:
        return None
    grid = _enlarge(_pairs(corners), scale).reshape(*meta.shape[:2], 2)
    if grid.shape[0] > grid.shape[1]:
        grid = grid.swapaxes(0, 1)
    return CornerGrid((grid.shape[1], grid.shape[0]), grid.reshape(-1, 2))


def eight_bits(grey: NDArray) -> NDArray[np.uint8]:
    """Return the picture as (H, W) uint8.

    A uint16 picture is scaled so that all but its darkest and its brightest thousandth span the
    range.
    """
    if grey.dtype == np.uint8:
        return np.ascontiguousarray(grey)
    low, high = np.percentile(grey, (0.1, 99.9))
    scaled = (grey.astype(np.float32) - low) * (255 / max(high - low, 1))
    return np.asarray(np.clip(np.rint(scaled), 0, 255), np.uint8)


def refine(grey: NDArray, corners: NDArray, board: Board) -> NDArray[np.float64]:
    """Return (count, 2) px, each corner moved by cornerSubPix to where the edges around it meet."""
    half = half_window(corners, board)
    reach = half + 4
    low = np.maximum(np.floor(corners.min(0)).astype(int) - reach, 0)
    high = np.ceil(corners.max(0)).astype(int) + reach + 1
    area = grey[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    smooth = cv2.GaussianBlur(area, (0, 0), max(half / 8, 1.0))  # takes noise from the gradients
    fine = cv2.resize(
        smooth, None, fx=REFINEMENT_SCALE, fy=REFINEMENT_SCALE, interpolation=cv2.INTER_CUBIC
    )
    start = ((corners - low + 0.5) * REFINEMENT_SCALE - 0.5).reshape(-1, 1, 2).astype(np.float32)
    refined = _pairs(
        cv2.cornerSubPix(
            fine, start, (REFINEMENT_SCALE * half, REFINEMENT_SCALE * half), (-1, -1), STOP
        )
    )
    return np.asarray((refined + 0.5) / REFINEMENT_SCALE - 0.5 + low)


def is_regular(corners: NDArray, board: Board, shape: tuple[int, ...]) -> bool:
    """True if (count, 2) px corners are a full grid inside a picture of this (H, W) shape: not
    folded, and bent smoothly if at all.
    """
    return is_inside(corners, shape) and is_smooth_grid(
        corners.reshape(board.rows, board.columns, 2)
    )


def is_smooth_grid(grid: NDArray) -> bool:
    """True if a (rows, columns, 2) px grid is not folded, and bent smoothly if at all."""
    falling = grid[1:, 1:] - grid[:-1, :-1]  # the diagonals of each square
    rising = grid[:-1, 1:] - grid[1:, :-1]
    area = rising[..., 0] * falling[..., 1] - rising[..., 1] * falling[..., 0]
    if not ((area > 0).all() or (area < 0).all()):
        return False
    return all(_is_smooth(_bend(lines)) for lines in (grid, grid.swapaxes(0, 1)))


def is_inside(corners: NDArray, shape: tuple[int, ...]) -> bool:
    """True if all (..., 2) px corners lie in a picture of this (H, W) shape."""
    return bool(
        ((corners >= 0) & (corners <= (shape[1] - 1, shape[0] - 1))).all()
    )  # never true of NaN


def half_window(corners: NDArray, board: Board) -> int:
    """Return cornerSubPix's half-size, px: small enough that no neighbouring corner pulls."""
    return int(np.clip(0.4 * _smallest_spacing(corners, board), 2, 15))


def _bend(lines: NDArray) -> NDArray[np.float64]:
    """Return (lines, corners - 2, 2), the offset of each corner from the middle of its neighbours
    on the line, in parts of their spacing.
    """
    previous = lines[:, :-2]
    following = lines[:, 2:]
    spacing = np.linalg.norm(following - previous, axis=-1, keepdims=True) / 2
    return np.asarray((lines[:, 1:-1] - (previous + following) / 2) / np.maximum(spacing, 1e-9))


def _is_smooth(bend: NDArray) -> bool:
    kinks = np.concatenate([np.diff(bend, axis=axis).ravel().reshape(-1, 2) for axis in (0, 1)])
    return bool(
        np.linalg.norm(bend, axis=-1).max() < MAX_BEND
        and np.linalg.norm(kinks, axis=-1).max() < MAX_KINK
    )


def _smallest_spacing(corners: NDArray, board: Board) -> float:
    """Return the smallest distance of neighbours on rows, columns and diagonals, px."""
    grid = corners.reshape(board.rows, board.columns, 2)
    steps = (
        grid[1:] - grid[:-1],
        grid[:, 1:] - grid[:, :-1],
        grid[1:, 1:] - grid[:-1, :-1],
        grid[1:, :-1] - grid[:-1, 1:],
    )
    return min(float(np.linalg.norm(step, axis=-1).min()) for step in steps)


_Search = Callable[[NDArray[np.uint8], Board], LocatedBoard | None]


def _by_saddles(grey: NDArray[np.uint8], board: Board) -> LocatedBoard | None:
    """Search a reduced picture, and one of half its size, which shows boards that are out of
    focus.
    """
    finest = reducing_factor(grey)
    for factor in (finest, min(2 * finest, *grey.shape)):
        grid = find_grid(reduce_picture(grey, factor), board)
        if grid and (corners := next(grid.board_positions(board), None)) is not None:
            return LocatedBoard(enlarge_corners(corners, factor), shows_two(grid, board))
    return None


def _by_largest_grid(grey: NDArray, board: Board) -> LocatedBoard | None:
    """Return the largest grid if it has the board's size: then it cannot be a part of a larger
    board.
    """
    grid = largest_grid(grey)
    if grid is None or grid.size != (
        max(board.columns, board.rows),
        min(board.columns, board.rows),
    ):
        return None
    columns, rows = grid.size
    upright = columns == board.columns
    return LocatedBoard(
        grid.corners
        if upright
        else grid.corners.reshape(rows, columns, 2).swapaxes(0, 1).reshape(-1, 2)
    )


def _by_sectors(grey: NDArray, board: Board) -> LocatedBoard | None:
    """Search the full picture: this finds smaller boards, and boards on a dark ground."""
    corners = _sector_corners(grey, board, SECTOR_FLAGS | cv2.CALIB_CB_EXHAUSTIVE)
    return None if corners is None else LocatedBoard(corners)


def _by_quads(grey: NDArray, board: Board) -> LocatedBoard | None:
    """Search the reduced picture: where there is no such board, the classic search takes many
    seconds for millions of pixels.
    """
    small, scale = _reduce(grey)
    if min(small.shape) < 20:  # its thresholds would have no window
        return None
    is_found, corners = cv2.findChessboardCorners(
        small, (board.columns, board.rows), flags=QUAD_FLAGS
    )
    return LocatedBoard(_enlarge(_pairs(corners), scale)) if is_found else None


def _sector_corners(grey: NDArray, board: Board, flags: int) -> NDArray[np.float64] | None:
    """Return (count, 2) px by OpenCV's sector detector, or None."""
    cv2.setRNGSeed(SEED)
    is_found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=flags)
    return _pairs(corners) if is_found else None


def _pairs(corners: MatLike) -> NDArray[np.float64]:
    """Return (count, 2) px: OpenCV 4 returns an extra axis of length 1."""
    return np.asarray(corners, np.float64).reshape(-1, 2)


def _reduce(grey: NDArray) -> tuple[NDArray, NDArray[np.float64]]:
    """Return the picture, reduced to at most MAX_SIDE px, and the (2,) scale of its width and
    height.
    """
    height, width = grey.shape
    factor = min(1.0, MAX_SIDE / max(height, width))
    size = max(round(width * factor), 1), max(round(height * factor), 1)
    small = grey if factor == 1 else cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return small, np.array(size) / (width, height)


def _enlarge(corners: NDArray, scale: NDArray) -> NDArray[np.float64]:
    return np.asarray((corners + 0.5) / scale - 0.5)


Detector = Literal["saddles", "sb", "classic"]
SEARCHES: tuple[tuple[Detector, _Search], ...] = (
    ("saddles", _by_saddles),
    ("sb", _by_largest_grid),
    ("sb", _by_sectors),
    ("classic", _by_quads),
)
"""The searches, tried in this order until one finds corners that are regular."""

"""One picture -> the corners of one board, to a few hundredths of a pixel and better.

Where a whole board's edges cross tells in 8 ms which corner is which (`calib.corners.saddle_grid`,
as in the live picture); cornerSubPix comes within hundredths of a pixel; a fit of every corner's
patch measures (`calib.corners.measure`). Boards that are not found so are looked for by the sector
detector (SB, 50 ms in a reduced picture), those that it cannot see, or sees wrongly, by the classic
one. SB's own corners are, on rendered views of known truth, off by 0.04 px, by 0.1 where the
squares are small and by 0.2 where the board is tilted by 50 degrees, all in one direction in a
view, with CALIB_CB_EXHAUSTIVE and CALIB_CB_ACCURACY and at 2 s a picture; CALIB_CB_NORMALIZE_IMAGE
doubles that. cornerSubPix on a smoothed picture leaves 0.03 px, without a direction, and the
patches 0.012.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from calib.corners.detection import Detection
from calib.corners.measure import measure
from calib.corners.ordering import canonical_order
from calib.corners.reduced import enlarged, live_factor, reduced
from calib.corners.saddle_grid import SaddleGrid, find_grid
from calib.session.board import Board

VERSION = 9
"""To be raised with every change that moves corners: kept detections are then made again."""

SEED = 0
"""SB's search trees draw from the thread's random numbers: where a board is partly hidden, the same
picture would give other corners after other pictures. (OpenCV's own start.)
"""
COARSE = 800  # px, longer side of the picture in which the board is looked for
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
# of the spacing, how far a corner may lie off the middle of its neighbours: perspective and lenses
# stay below 0.2
BEND = 0.3
KINK = (
    0.15  # of the spacing, how fast that may change from corner to corner: a skipped row makes 0.6
)
SEARCH = cv2.CALIB_CB_NORMALIZE_IMAGE
QUADS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE

FINER = 2
"""cornerSubPix interpolates linearly, which pulls corners towards pixel borders by 0.01 to 0.02 px;
on a picture enlarged by cubic splines it does not.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """A chessboard of unknown size in a picture."""

    size: tuple[int, int]
    """Columns and rows, no fewer columns than rows."""
    corners: NDArray[np.float64]
    """(columns * rows, 2) px, roughly; row by row, columns fastest."""


@dataclass(frozen=True, slots=True, eq=False)
class Rough:
    """Where a search saw the board."""

    corners: NDArray[np.float64]
    """(count, 2) px, some pixels off at worst."""
    twice: bool = False
    """Whether it saw a second one."""


def find_corners(grey: NDArray, board: Board) -> Detection | None:
    """The board's corners in a (H, W) uint8 or uint16 picture; None where it is not wholly and
    clearly there.
    """
    grey, every_bit = eight_bits(grey), grey
    for detector, search in SEARCHES:
        rough = search(grey, board)
        if rough and _is_inside(
            rough.corners, grey.shape
        ):  # SB's corners may be pixels off: only refined ones are judged
            corners = refine(grey, rough.corners, board)
            if is_regular(corners, board, grey.shape):
                measured = measure(every_bit, canonical_order(grey, corners, board), board)
                return Detection(measured.corners, measured.covariances, detector, rough.twice)
    return None


def shows_two(grid: SaddleGrid, board: Board) -> bool:
    """Whether a second whole board of this kind lies beside the first."""
    second = grid.beside.whole(board) if grid.beside else ()
    return any(is_smooth_grid(whole.reshape(board.rows, board.columns, 2)) for whole in second)


def largest_grid(grey: NDArray) -> Grid | None:
    """The largest chessboard in a (H, W) uint8 picture, whatever its size; part of a board where
    the rest is hidden.
    """
    small, scale = _reduced(grey)
    cv2.setRNGSeed(SEED)
    found, corners, meta = cv2.findChessboardCornersSBWithMeta(
        small, (3, 3), SEARCH | cv2.CALIB_CB_LARGER
    )
    if not found:
        return None
    grid = _enlarged(_pairs(corners), scale).reshape(*meta.shape[:2], 2)
    if grid.shape[0] > grid.shape[1]:
        grid = grid.swapaxes(0, 1)
    return Grid((grid.shape[1], grid.shape[0]), grid.reshape(-1, 2))


def has_grid(grey: NDArray, board: Board) -> bool:
    """Whether a quick look at a (H, W) uint8 picture finds this board."""
    small, _ = _reduced(grey)
    corners = _sectors(small, board, SEARCH)
    return (
        corners is not None
        and _is_inside(corners, small.shape)
        and is_regular(refine(small, corners, board), board, small.shape)
    )


def eight_bits(grey: NDArray) -> NDArray[np.uint8]:
    """(H, W) uint8.

    Of uint16, all but the darkest and the brightest thousandth is spread over the range.
    """
    if grey.dtype == np.uint8:
        return np.ascontiguousarray(grey)
    low, high = np.percentile(grey, (0.1, 99.9))
    scaled = (grey.astype(np.float32) - low) * (255 / max(high - low, 1))
    return np.asarray(np.clip(np.rint(scaled), 0, 255), np.uint8)


def refine(grey: NDArray, corners: NDArray, board: Board) -> NDArray[np.float64]:
    """(count, 2) px, each corner moved to where the edges around it meet, by cornerSubPix."""
    half = half_window(corners, board)
    reach = half + 4
    low = np.maximum(np.floor(corners.min(0)).astype(int) - reach, 0)
    high = np.ceil(corners.max(0)).astype(int) + reach + 1
    area = grey[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    smooth = cv2.GaussianBlur(area, (0, 0), max(half / 8, 1.0))  # takes noise from the gradients
    fine = cv2.resize(smooth, None, fx=FINER, fy=FINER, interpolation=cv2.INTER_CUBIC)
    start = ((corners - low + 0.5) * FINER - 0.5).reshape(-1, 1, 2).astype(np.float32)
    found = _pairs(cv2.cornerSubPix(fine, start, (FINER * half, FINER * half), (-1, -1), STOP))
    return np.asarray((found + 0.5) / FINER - 0.5 + low)


def is_regular(corners: NDArray, board: Board, shape: tuple[int, ...]) -> bool:
    """Whether (count, 2) px corners are a whole grid inside a picture of this (H, W): unfolded, and
    bent smoothly if at all.
    """
    return _is_inside(corners, shape) and is_smooth_grid(
        corners.reshape(board.rows, board.columns, 2)
    )


def is_smooth_grid(grid: NDArray) -> bool:
    """Whether (rows, columns, 2) px are that, wherever they are."""
    down, up = (
        grid[1:, 1:] - grid[:-1, :-1],
        grid[:-1, 1:] - grid[1:, :-1],
    )  # the diagonals of each square
    area = up[..., 0] * down[..., 1] - up[..., 1] * down[..., 0]
    if not ((area > 0).all() or (area < 0).all()):
        return False
    return all(_is_smooth(_bend(lines)) for lines in (grid, grid.swapaxes(0, 1)))


def _is_inside(corners: NDArray, shape: tuple[int, ...]) -> bool:
    """Whether all (..., 2) px are, in a picture of this (H, W)."""
    return bool(
        ((corners >= 0) & (corners <= (shape[1] - 1, shape[0] - 1))).all()
    )  # never true of NaN


def half_window(corners: NDArray, board: Board) -> int:
    """px, cornerSubPix's half-size: far enough from the neighbouring corners that none of them
    pulls.
    """
    return int(np.clip(0.4 * _smallest_spacing(corners, board), 2, 15))


def _bend(lines: NDArray) -> NDArray[np.float64]:
    """(lines, corners - 2, 2) how far each corner lies off the middle of its neighbours on the
    line, in parts of their spacing.
    """
    before, here, after = lines[:, :-2], lines[:, 1:-1], lines[:, 2:]
    spacing = np.linalg.norm(after - before, axis=-1, keepdims=True) / 2
    return np.asarray((here - (before + after) / 2) / np.maximum(spacing, 1e-9))


def _is_smooth(bend: NDArray) -> bool:
    kinks = np.concatenate([np.diff(bend, axis=axis).ravel().reshape(-1, 2) for axis in (0, 1)])
    return bool(
        np.linalg.norm(bend, axis=-1).max() < BEND and np.linalg.norm(kinks, axis=-1).max() < KINK
    )


def _smallest_spacing(corners: NDArray, board: Board) -> float:
    """px, along rows, columns and diagonals."""
    grid = corners.reshape(board.rows, board.columns, 2)
    steps = (
        grid[1:] - grid[:-1],
        grid[:, 1:] - grid[:, :-1],
        grid[1:, 1:] - grid[:-1, :-1],
        grid[1:, :-1] - grid[:-1, 1:],
    )
    return min(float(np.linalg.norm(step, axis=-1).min()) for step in steps)


_Search = Callable[[NDArray[np.uint8], Board], Rough | None]


def _by_saddles(grey: NDArray[np.uint8], board: Board) -> Rough | None:
    """In a reduced picture, and in one half as fine, which shows boards that are out of focus."""
    finest = live_factor(grey)
    for factor in (finest, min(2 * finest, *grey.shape)):
        grid = find_grid(reduced(grey, factor), board)
        if grid and (whole := next(grid.whole(board), None)) is not None:
            return Rough(enlarged(whole, factor), shows_two(grid, board))
    return None


def _sighted(grey: NDArray, board: Board) -> Rough | None:
    """The largest grid, if it has the board's size: it cannot be a part of a larger board."""
    grid = largest_grid(grey)
    if grid is None or grid.size != (
        max(board.columns, board.rows),
        min(board.columns, board.rows),
    ):
        return None
    columns, rows = grid.size
    upright = columns == board.columns
    return Rough(
        grid.corners
        if upright
        else grid.corners.reshape(rows, columns, 2).swapaxes(0, 1).reshape(-1, 2)
    )


def _by_sectors(grey: NDArray, board: Board) -> Rough | None:
    """In the whole picture: sees smaller boards, and boards on a dark ground."""
    corners = _sectors(grey, board, SEARCH | cv2.CALIB_CB_EXHAUSTIVE)
    return None if corners is None else Rough(corners)


def _by_quads(grey: NDArray, board: Board) -> Rough | None:
    """In the reduced picture: where there is no such board, the classic search takes many seconds
    for millions of pixels.
    """
    small, scale = _reduced(grey)
    if min(small.shape) < 20:  # its thresholds would have no window
        return None
    found, corners = cv2.findChessboardCorners(small, (board.columns, board.rows), flags=QUADS)
    return Rough(_enlarged(_pairs(corners), scale)) if found else None


def _sectors(grey: NDArray, board: Board, flags: int) -> NDArray[np.float64] | None:
    cv2.setRNGSeed(SEED)
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=flags)
    return _pairs(corners) if found else None


def _pairs(corners: MatLike) -> NDArray[np.float64]:
    """(count, 2): OpenCV 4 has an axis of length 1 between."""
    return np.asarray(corners, np.float64).reshape(-1, 2)


def _reduced(grey: NDArray) -> tuple[NDArray, NDArray[np.float64]]:
    """The picture no longer than COARSE, and (2,) its width and height as parts of the whole
    one's.
    """
    height, width = grey.shape
    factor = min(1.0, COARSE / max(height, width))
    size = max(round(width * factor), 1), max(round(height * factor), 1)
    small = grey if factor == 1 else cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return small, np.array(size) / (width, height)


def _enlarged(corners: NDArray, scale: NDArray) -> NDArray[np.float64]:
    return np.asarray((corners + 0.5) / scale - 0.5)


Detector = Literal["saddles", "sb", "classic"]
SEARCHES: tuple[tuple[Detector, _Search], ...] = (
    ("saddles", _by_saddles),
    ("sb", _sighted),
    ("sb", _by_sectors),
    ("classic", _by_quads),
)
"""In this order, until the corners that one found are regular."""

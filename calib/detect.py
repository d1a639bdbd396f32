"""One picture -> the corners of one board, to a few hundredths of a pixel.

A coarse look finds the board, then the sector detector (SB) measures inside a crop: on whole pictures it is ten times slower and no better.
Its corners are averaged with cornerSubPix's, whose errors are of another kind: on five rendered sessions and a real one the mean is as good
as the better of the two, or up to a quarter better. NORMALIZE_IMAGE doubles SB's error, so it only helps to find, and to measure where
nothing else does. Boards that SB cannot see, or sees wrongly, are left to the classic detector.
"""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from calib.board import Board
from calib.order import canonical_order

VERSION = 1
"""To be raised with every change that moves corners: kept detections are then made again."""

COARSE = 800  # px, longer side of the picture in which the board is looked for
SHARP_AREA = 1_500_000  # px, larger crops are not doubled by CALIB_CB_ACCURACY: it would take seconds, and their squares are large
SMOOTHING = 1.0  # px, takes noise from cornerSubPix's gradients
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
BEND = 0.3  # of the spacing, how far a corner may lie off the middle of its neighbours: perspective and lenses stay below 0.2
KINK = 0.15  # of the spacing, how fast that may change from corner to corner: a skipped row makes 0.6
SEARCH = cv2.CALIB_CB_NORMALIZE_IMAGE
QUADS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """A board in a picture."""

    corners: NDArray[np.float64]
    """(count, 2) px, row by row, columns fastest, in the order of `canonical_order`."""
    detector: Literal["sb", "classic"]


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """A chessboard of unknown size in a picture."""

    size: tuple[int, int]
    """Inner corners along the longer side, and along the shorter."""
    corners: NDArray[np.float64]
    """(corners, 2) px, roughly."""


def find_corners(grey: NDArray, board: Board) -> Found | None:
    """The board's corners in a (H, W) uint8 or uint16 picture; None where it is not wholly and clearly there."""
    grey = eight_bits(grey)
    corners = _by_sectors(grey, board)
    if corners is not None and is_regular(corners, board, grey.shape):
        return Found(canonical_order(grey, corners, board), "sb")
    corners = _by_quads(grey, board)
    if corners is not None and is_regular(corners, board, grey.shape):
        return Found(canonical_order(grey, corners, board), "classic")
    return None


def largest_grid(grey: NDArray) -> Grid | None:
    """The largest chessboard in a (H, W) uint8 picture, whatever its size; part of a board where the rest is hidden."""
    small, scale = _reduced(grey)
    found, corners, meta = cv2.findChessboardCornersSBWithMeta(small, (3, 3), SEARCH | cv2.CALIB_CB_LARGER)
    if not found:
        return None
    rows, columns = meta.shape[:2]
    return Grid((max(rows, columns), min(rows, columns)), _enlarged(_pairs(corners), scale))


def has_grid(grey: NDArray, board: Board) -> bool:
    """Whether a quick look at a (H, W) uint8 picture finds this board."""
    small, _ = _reduced(grey)
    corners = _sectors(small, board, SEARCH)
    return corners is not None and is_regular(corners, board, small.shape)


def eight_bits(grey: NDArray) -> NDArray[np.uint8]:
    """(H, W) uint8. Of uint16, all but the darkest and the brightest thousandth is spread over the range."""
    if grey.dtype == np.uint8:
        return np.ascontiguousarray(grey)
    low, high = np.percentile(grey, (0.1, 99.9))
    scaled = (grey.astype(np.float32) - low) * (255 / max(high - low, 1))
    return np.asarray(np.clip(np.rint(scaled), 0, 255), np.uint8)


def refine(grey: NDArray, corners: NDArray, board: Board) -> NDArray[np.float64]:
    """(count, 2) px, each corner moved to where the edges around it meet, by cornerSubPix."""
    smooth = cv2.GaussianBlur(grey, (0, 0), SMOOTHING)
    start = np.ascontiguousarray(corners.reshape(-1, 1, 2), np.float32).copy()
    half = half_window(corners, board)
    return _pairs(cv2.cornerSubPix(smooth, start, (half, half), (-1, -1), STOP))


def is_regular(corners: NDArray, board: Board, shape: tuple[int, ...]) -> bool:
    """Whether (count, 2) px corners are a whole grid inside a picture of this (H, W): unfolded, and bent smoothly if at all."""
    grid = corners.reshape(board.rows, board.columns, 2)
    if not np.isfinite(grid).all() or (grid < -0.5).any() or (grid > np.array([shape[1], shape[0]]) - 0.5).any():
        return False
    down, up = grid[1:, 1:] - grid[:-1, :-1], grid[:-1, 1:] - grid[1:, :-1]  # the diagonals of each square
    area = up[..., 0] * down[..., 1] - up[..., 1] * down[..., 0]
    if not ((area > 0).all() or (area < 0).all()):
        return False
    return all(_is_smooth(_bend(lines)) for lines in (grid, grid.swapaxes(0, 1)))


def half_window(corners: NDArray, board: Board) -> int:
    """px, cornerSubPix's half-size: far enough from the neighbouring corners that none of them pulls."""
    return int(np.clip(0.4 * _smallest_spacing(corners, board), 2, 11))


def _bend(lines: NDArray) -> NDArray[np.float64]:
    """(lines, corners - 2, 2) how far each corner lies off the middle of its neighbours on the line, in parts of their spacing."""
    before, here, after = lines[:, :-2], lines[:, 1:-1], lines[:, 2:]
    spacing = np.linalg.norm(after - before, axis=-1, keepdims=True) / 2
    return np.asarray((here - (before + after) / 2) / np.maximum(spacing, 1e-9))


def _is_smooth(bend: NDArray) -> bool:
    kinks = np.concatenate([np.diff(bend, axis=axis).ravel().reshape(-1, 2) for axis in (0, 1)])
    return bool(np.linalg.norm(bend, axis=-1).max() < BEND and np.linalg.norm(kinks, axis=-1).max() < KINK)


def _smallest_spacing(corners: NDArray, board: Board) -> float:
    """px, along rows, columns and diagonals."""
    grid = corners.reshape(board.rows, board.columns, 2)
    steps = (grid[1:] - grid[:-1], grid[:, 1:] - grid[:, :-1], grid[1:, 1:] - grid[:-1, :-1], grid[1:, :-1] - grid[:-1, 1:])
    return min(float(np.linalg.norm(step, axis=-1).min()) for step in steps)


def _by_sectors(grey: NDArray, board: Board) -> NDArray[np.float64] | None:
    sighted = largest_grid(grey)
    if sighted is not None and sighted.size == (max(board.columns, board.rows), min(board.columns, board.rows)):
        rough: NDArray | None = sighted.corners
    else:
        rough = _sectors(grey, board, SEARCH | cv2.CALIB_CB_EXHAUSTIVE)
    if rough is None:
        return None
    low, high = rough.min(0), rough.max(0)
    margin = 2 * float((high - low).max()) / (min(board.columns, board.rows) - 1)
    left, top = np.maximum(low - margin, 0).astype(int)
    right, bottom = (high + margin).astype(int) + 1
    crop = np.ascontiguousarray(grey[top:bottom, left:right])
    flags = cv2.CALIB_CB_EXHAUSTIVE | (cv2.CALIB_CB_ACCURACY if crop.size <= SHARP_AREA else 0)
    corners = _sectors(crop, board, flags)
    if corners is None:
        corners = _sectors(crop, board, flags | cv2.CALIB_CB_NORMALIZE_IMAGE)
    return None if corners is None else (corners + refine(crop, corners, board)) / 2 + (left, top)


def _by_quads(grey: NDArray, board: Board) -> NDArray[np.float64] | None:
    """In the reduced picture: where there is no such board, the classic search takes many seconds for millions of pixels."""
    small, scale = _reduced(grey)
    if min(small.shape) < 20:  # its thresholds would have no window
        return None
    found, corners = cv2.findChessboardCorners(small, (board.columns, board.rows), flags=QUADS)
    return refine(grey, _enlarged(_pairs(corners), scale), board) if found else None


def _sectors(grey: NDArray, board: Board, flags: int) -> NDArray[np.float64] | None:
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=flags)
    return _pairs(corners) if found else None


def _pairs(corners: MatLike) -> NDArray[np.float64]:
    """(count, 2): OpenCV 4 has an axis of length 1 between."""
    return np.asarray(corners, np.float64).reshape(-1, 2)


def _reduced(grey: NDArray) -> tuple[NDArray, NDArray[np.float64]]:
    """The picture no longer than COARSE, and (2,) its width and height as parts of the whole one's."""
    height, width = grey.shape
    factor = min(1.0, COARSE / max(height, width))
    size = max(round(width * factor), 1), max(round(height * factor), 1)
    small = grey if factor == 1 else cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return small, np.array(size) / (width, height)


def _enlarged(corners: NDArray, scale: NDArray) -> NDArray[np.float64]:
    return np.asarray((corners + 0.5) / scale - 0.5)

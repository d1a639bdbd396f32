"""Find the corners of a partly visible checkerboard, if the board's outline tells which corners
they are.

A checkerboard that is moved by a square looks the same, and a camera model explains it equally well
with the board moved back. So neither a model nor the colours can tell which corners a part of the
board shows. The outline can: the outermost row or column is where the squares end and the white
margin begins, all along a side of the part. Two neighbouring sides locate the part on a square
board; on another board, the direction of its columns must be clear, too.
"""

from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.detect import (
    CornerGrid,
    eight_bits,
    is_inside,
    is_smooth_grid,
    largest_grid,
    refine,
)
from calib.corners.detection import Detection, NotFound
from calib.corners.grid_growth import fill_grid, grow_grid
from calib.corners.measure import measure_corners
from calib.corners.ordering import canonical_order
from calib.session.board import Board

Floats = NDArray[np.float64]

MIN_LINES = 3  # of corners, in either direction of a part
MIN_CORNERS = 12
# squares outward of the outermost corners: where the last squares are sampled, and the margin
SQUARE_SAMPLES = (0.5, 0.85)
MARGIN_SAMPLES = (1.15, 1.3)
# in parts of the difference from black to white: what is below MAX_BLACK is black, what is above
# MIN_WHITE is white
MAX_BLACK = 0.35
MIN_WHITE = 0.75
MIN_CONTRAST = 0.5  # of the contrast within the part, that the last squares must have
MAX_VARIATION = 0.8  # within a square, of its contrast to the squares around it
MIN_FRACTION = 0.6  # of the squares, or of those at an end, that must pass
MIN_BLACK_SQUARES = 2  # of the last squares of a side: their ends show the outline


def find_partial_board(grey: NDArray, board: Board) -> Detection | NotFound | None:
    """Find the board in a (H, W) uint8 or uint16 picture that does not show all of it; None where
    no part of a board is visible either.
    """
    every_bit = grey
    grey = eight_bits(every_bit)
    grid = largest_grid(grey)
    if grid is None or min(grid.size) < MIN_LINES or np.prod(grid.size) < MIN_CORNERS:
        return None
    refined = _refine_single_squares(grey, grid)
    if refined is None:
        return None
    corners = grow_grid(grey, every_bit, refined)
    rows, columns = corners.shape[:2]
    if min(rows, columns) < MIN_LINES or np.isfinite(corners[..., 0]).sum() < MIN_CORNERS:
        return None
    if not is_smooth_grid(fill_grid(corners)):
        return None
    places = _possible_places(
        _find_ends(grey, corners), (rows, columns), (board.rows, board.columns)
    )
    if not places:
        return None
    if len(places) > 1:
        return NotFound(
            f"{columns}x{rows} corners of a {board} board are seen, and not which: show it whole,"
            " or two neighbouring sides of it with their white margin"
        )
    size, (row, column) = places[0]
    full_grid = np.full((*size, 2), np.nan)
    full_grid[row : row + rows, column : column + columns] = corners
    if size != (board.rows, board.columns):
        full_grid = full_grid.swapaxes(0, 1)
    measured = measure_corners(
        every_bit, canonical_order(grey, full_grid.reshape(-1, 2), board), board
    )
    if np.isfinite(measured.corners[:, 0]).sum() < MIN_CORNERS:
        return None
    return Detection(measured.corners, measured.covariances, measured.blurs, "part")


def _refine_single_squares(grey: NDArray[np.uint8], grid: CornerGrid) -> Floats | None:
    """Return (rows, columns, 2) px at every corner: where something is hidden, the lines of the
    detected grid may be two squares apart.
    """
    corners = grid.corners.reshape(grid.size[1], grid.size[0], 2)
    for double_rows, double_columns in product((False, True), repeat=2):
        finer = _double_rows(corners) if double_rows else corners
        finer = _double_rows(finer.swapaxes(0, 1)).swapaxes(0, 1) if double_columns else finer
        if not is_inside(finer, grey.shape):
            continue
        rows, columns = finer.shape[:2]
        refined = refine(grey, finer.reshape(-1, 2), Board(columns, rows, 1.0)).reshape(finer.shape)
        if _is_checkered(grey, refined):
            return refined
    return None


def _double_rows(grid: Floats) -> Floats:
    """Return (2 rows - 1, columns, 2) px, with a line between any two, on the parabola through
    three.
    """
    bends = grid[2:] - 2 * grid[1:-1] + grid[:-2]
    bends = (np.concatenate([bends[:1], bends]) + np.concatenate([bends, bends[-1:]])) / 2
    finer = np.repeat(grid, 2, 0)[:-1]
    finer[1::2] = (grid[:-1] + grid[1:]) / 2 - bends / 8
    return finer


def _is_checkered(grey: NDArray[np.uint8], grid: Floats) -> bool:
    """True if most of the squares between the (rows, columns, 2) px corners are of one grey each,
    alternating between black and white.
    """
    corners = grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]
    middle: Floats = np.mean(corners, 0)
    light = np.stack([_sample(grey, middle + (corner - middle) / 2) for corner in corners])
    sign = (-1.0) ** np.add.outer(*map(np.arange, middle.shape[:2]))
    square_light = light.mean(0)
    contrast = (square_light - cv2.blur(square_light, (3, 3))) * sign  # to its neighbours
    uniform = (np.ptp(light, 0) < MAX_VARIATION * np.abs(contrast)) & (
        contrast * np.sign(np.median(contrast)) > 0
    )
    return bool(uniform.mean() > MIN_FRACTION)


BoardEnds = tuple[bool, bool, bool, bool]
"""True where the board ends: above the part's first row, below its last, left of its first column,
right of its last.
"""


def _find_ends(grey: NDArray[np.uint8], grid: Floats) -> BoardEnds:
    """Return where the board ends around a (rows, columns, 2) px part."""
    visible = np.isfinite(grid[..., 0])
    filled = fill_grid(grid)
    columns = filled.swapaxes(0, 1)
    return (
        _ends_above(grey, filled, visible[0]),
        _ends_above(grey, filled[::-1], visible[-1]),
        _ends_above(grey, columns, visible[:, 0]),
        _ends_above(grey, columns[::-1], visible[:, -1]),
    )


def _ends_above(grey: NDArray[np.uint8], grid: Floats, visible: NDArray[np.bool_]) -> bool:
    """True if the squares above the first row of corners are the board's last: each black one ends
    where a square must, and everything above them is white.

    Only the squares whose corners in that row are visible are examined, and they must be most of
    the row.
    """
    examined = visible[:-1] & visible[1:]
    if examined.mean() < MIN_FRACTION:
        return False
    middles = (grid[:, :-1] + grid[:, 1:]) / 2
    places = np.stack(
        [_outward(middles, squares) for squares in (*SQUARE_SAMPLES, *MARGIN_SAMPLES)]
    )  # (4, columns - 1, 2)
    if not ((places >= 0) & (places <= (grey.shape[1] - 1, grey.shape[0] - 1)))[:, examined].all():
        return False
    light = _sample(grey, places)
    inner_light = _sample(grey, (middles[:1] + middles[1:2]) / 2)[
        0
    ]  # the first squares inward: of the other colour each
    odd = np.arange(len(inner_light)) % 2 == 1
    black = odd == (np.median(inner_light[odd]) > np.median(inner_light[~odd]))
    white = examined & ~black
    black = examined & black
    index = np.arange(len(inner_light))
    if black.sum() < MIN_BLACK_SQUARES or not white.any():
        return False
    dark = np.interp(index, index[black], light[0, black])
    bright = np.interp(index, index[white], light[0, white])
    contrast = bright - dark
    clear = contrast[examined].min() > MIN_CONTRAST * abs(
        np.median(inner_light[odd]) - np.median(inner_light[~odd])
    )
    relative_light = (light - dark) / np.maximum(contrast, 1)
    return bool(
        clear
        and (relative_light[:2, black] < MAX_BLACK).all()
        and (relative_light[:2, white] > MIN_WHITE).all()
        and (relative_light[2:, examined] > MIN_WHITE).all()
    )


def _outward(lines: Floats, squares: float) -> Floats:
    """Return (columns, 2) px, this number of squares above the first line of (rows, columns, 2) px,
    on the parabola through the first three.
    """
    first, second, third = lines[:3]
    outward: Floats = (
        first
        - squares * (4 * second - 3 * first - third) / 2
        + squares**2 * (first - 2 * second + third) / 2
    )
    return outward


def _sample(grey: NDArray[np.uint8], places: Floats) -> Floats:
    """Return (A, B) grey levels at (A, B, 2) px."""
    x, y = np.moveaxis(places.astype(np.float32), -1, 0)
    return np.asarray(cv2.remap(grey, x, y, cv2.INTER_LINEAR), np.float64)


Place = tuple[tuple[int, int], tuple[int, int]]
"""(rows, columns) of the board in the part's orientation, which may exchange them; and (row,
column) of the part's first corner on the board.
"""


def _possible_places(
    ends: BoardEnds, part_shape: tuple[int, int], board_shape: tuple[int, int]
) -> list[Place]:
    """Return all places that a part of these rows and columns can have on a board of these."""
    at_top, at_bottom, at_left, at_right = ends
    return [
        (size, place)
        for size in {board_shape, board_shape[::-1]}
        for place in product(
            _possible_starts(at_top, at_bottom, part_shape[0], size[0]),
            _possible_starts(at_left, at_right, part_shape[1], size[1]),
        )
    ]


def _possible_starts(
    starts_line: bool, ends_line: bool, part_length: int, board_length: int
) -> list[int]:
    """Return where a run of corners can start on a line of the board. `starts_line` and `ends_line`
    are true if the run is known to contain the line's first or last corner.
    """
    return [
        start
        for start in range(board_length - part_length + 1)
        if (start == 0 or not starts_line)
        and (start == board_length - part_length or not ends_line)
    ]

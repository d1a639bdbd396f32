"""Part of a checkerboard in a picture -> its corners, if the board's own outline says which they
are.

A checkerboard moved by a square looks the same, and a model of the camera explains it as well, with
the board moved back: no model can tell which corners a part of it shows, nor can colours. The
outline can: where the squares end and the white margin begins, all along a side of the part, there
is the board's outermost row or column. Two neighbouring sides tell the part of a square board; of
another, it must also be clear which way its columns run.
"""

from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.detect import Grid, eight_bits, is_smooth_grid, largest_grid, refine
from calib.corners.detection import Detection, NotFound
from calib.corners.growth import filled, grown
from calib.corners.measure import measure
from calib.corners.ordering import canonical_order
from calib.session.board import Board

Floats = NDArray[np.float64]

NARROWEST = 3  # corners, of a part
FEWEST = 12  # corners
INSIDE, BEYOND = (
    (0.5, 0.85),
    (
        1.15,
        1.3,
    ),
)  # squares outward of the outermost corners: where the last squares are seen, and the margin
DARK, LIGHT = (
    0.35,
    0.75,
)  # of the way from black to white: what is below is black, what is above is white
CLEAR = 0.5  # of the contrast within the part, that the last squares must have
ALIKE, MOST = (
    0.8,
    0.6,
    # of a square's contrast against those around it, within the square; of the squares, or of those
    # at an end
)
FEWEST_BLACK = 2  # of the last squares of a side: their ends are what is seen of the outline


def find_part(grey: NDArray, board: Board) -> Detection | NotFound | None:
    """In a (H, W) uint8 or uint16 picture, in which there is no whole board; None where there is no
    part of one either.
    """
    grey, every_bit = eight_bits(grey), grey
    grid = largest_grid(grey)
    if grid is None or min(grid.size) < NARROWEST or np.prod(grid.size) < FEWEST:
        return None
    rough = _of_single_squares(grey, grid)
    if rough is None:
        return None
    corners = grown(grey, every_bit, rough)
    rows, columns = corners.shape[:2]
    if min(rows, columns) < NARROWEST or np.isfinite(corners[..., 0]).sum() < FEWEST:
        return None
    whole = filled(corners)
    if not is_smooth_grid(whole):
        return None
    places = _places(_ends(grey, corners), (rows, columns), (board.rows, board.columns))
    if not places:
        return None
    if len(places) > 1:
        return NotFound(
            f"{columns}x{rows} corners of a {board} board are seen, and not which: show it whole,"
            " or two neighbouring sides of it with their white margin"
        )
    size, (row, column) = places[0]
    whole = np.full((*size, 2), np.nan)
    whole[row : row + rows, column : column + columns] = corners
    if size != (board.rows, board.columns):
        whole = whole.swapaxes(0, 1)
    measured = measure(every_bit, canonical_order(grey, whole.reshape(-1, 2), board), board)
    if np.isfinite(measured.corners[:, 0]).sum() < FEWEST:
        return None
    return Detection(measured.corners, measured.covariances, "part")


def _of_single_squares(grey: NDArray[np.uint8], grid: Grid) -> Floats | None:
    """(rows, columns, 2) px, corner by corner: where something is hidden, the detector's lines may
    be two squares apart.
    """
    corners = grid.corners.reshape(grid.size[1], grid.size[0], 2)
    for double_rows, double_columns in product((False, True), repeat=2):
        finer = _doubled(corners) if double_rows else corners
        finer = _doubled(finer.swapaxes(0, 1)).swapaxes(0, 1) if double_columns else finer
        rows, columns = finer.shape[:2]
        refined = refine(grey, finer.reshape(-1, 2), Board(columns, rows, 1.0)).reshape(finer.shape)
        if _checkered(grey, refined):
            return refined
    return None


def _doubled(grid: Floats) -> Floats:
    """(2 rows - 1, columns, 2) px, with a line between any two, on the parabola through three."""
    bends = grid[2:] - 2 * grid[1:-1] + grid[:-2]
    bends = (np.concatenate([bends[:1], bends]) + np.concatenate([bends, bends[-1:]])) / 2
    finer = np.repeat(grid, 2, 0)[:-1]
    finer[1::2] = (grid[:-1] + grid[1:]) / 2 - bends / 8
    return finer


def _checkered(grey: NDArray[np.uint8], grid: Floats) -> bool:
    """Whether most of the squares between (rows, columns, 2) px are of one grey each, and of black
    and white in turn.
    """
    corners = grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]
    middle: Floats = np.mean(corners, 0)
    light = np.stack([_light(grey, middle + (corner - middle) / 2) for corner in corners])
    sign = (-1.0) ** np.add.outer(*map(np.arange, middle.shape[:2]))
    own = light.mean(0)
    against = (own - cv2.blur(own, (3, 3))) * sign  # its neighbours
    alike = (np.ptp(light, 0) < ALIKE * np.abs(against)) & (
        against * np.sign(np.median(against)) > 0
    )
    return bool(alike.mean() > MOST)


Ends = tuple[bool, bool, bool, bool]
"""Whether the board ends above the part's first row, below its last, left of its first column,
right of its last.
"""


def _ends(grey: NDArray[np.uint8], grid: Floats) -> Ends:
    """Of a (rows, columns, 2) px part."""
    seen, whole = np.isfinite(grid[..., 0]), filled(grid)
    turns = [(whole, seen), (whole[::-1], seen[::-1])]
    turns += [
        (lines.swapaxes(0, 1), own.T)
        for lines, own in ((whole, seen), (whole[:, ::-1], seen[:, ::-1]))
    ]
    above, below, left, right = (_ends_above(grey, lines, own[0]) for lines, own in turns)
    return above, below, left, right


def _ends_above(grey: NDArray[np.uint8], grid: Floats, seen: NDArray[np.bool_]) -> bool:
    """Whether the squares above the first row of corners are the board's last: each black one ends
    where a square must, and all of it beyond is white. Those are asked whose corners in that row
    are seen, and they must be most of it.
    """
    asked = seen[:-1] & seen[1:]
    if asked.mean() < MOST:
        return False
    middles = (grid[:, :-1] + grid[:, 1:]) / 2
    places = np.stack(
        [_outward(middles, squares) for squares in (*INSIDE, *BEYOND)]
    )  # (4, columns - 1, 2)
    if not ((places >= 0) & (places <= (grey.shape[1] - 1, grey.shape[0] - 1)))[:, asked].all():
        return False
    light = _light(grey, places)
    within = _light(grey, (middles[:1] + middles[1:2]) / 2)[
        0
    ]  # the first squares inward: of the other colour each
    odd = np.arange(len(within)) % 2 == 1
    black = odd == (np.median(within[odd]) > np.median(within[~odd]))
    black, white, index = asked & black, asked & ~black, np.arange(len(within))
    if black.sum() < FEWEST_BLACK or not white.any():
        return False
    dark, bright = (
        np.interp(index, index[black], light[0, black]),
        np.interp(index, index[white], light[0, white]),
    )
    contrast = bright - dark
    clear = contrast[asked].min() > CLEAR * abs(np.median(within[odd]) - np.median(within[~odd]))
    part = (light - dark) / np.maximum(contrast, 1)
    return bool(
        clear
        and (part[:2, black] < DARK).all()
        and (part[:2, white] > LIGHT).all()
        and (part[2:, asked] > LIGHT).all()
    )


def _outward(lines: Floats, squares: float) -> Floats:
    """(columns, 2) px, so many squares above the first of (rows, columns, 2) px, by the parabola
    through the first three.
    """
    first, second, third = lines[:3]
    outward: Floats = (
        first
        - squares * (4 * second - 3 * first - third) / 2
        + squares**2 * (first - 2 * second + third) / 2
    )
    return outward


def _light(grey: NDArray[np.uint8], places: Floats) -> Floats:
    """(A, B) grey levels, at (A, B, 2) px."""
    x, y = np.moveaxis(places.astype(np.float32), -1, 0)
    return np.asarray(cv2.remap(grey, x, y, cv2.INTER_LINEAR), np.float64)


Place = tuple[tuple[int, int], tuple[int, int]]
"""Rows and columns of the board as the part counts them, which may be its columns and rows; and the
row and column of the part's first corner in it.
"""


def _places(ends: Ends, part: tuple[int, int], board: tuple[int, int]) -> list[Place]:
    """All that a part of so many rows and columns can have on a board of so many."""
    above, below, left, right = ends
    return [
        (size, place)
        for size in {board, board[::-1]}
        for place in product(
            _starts(above, below, part[0], size[0]), _starts(left, right, part[1], size[1])
        )
    ]


def _starts(first: bool, last: bool, part: int, board: int) -> list[int]:
    """Where a run of so many corners can begin on a line of the board, which it may be known to
    begin or to end.
    """
    return [
        start
        for start in range(board - part + 1)
        if (start == 0 or not first) and (start == board - part or not last)
    ]

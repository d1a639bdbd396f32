"""One picture -> the corners of a board with markers, of as much of it as the picture shows.

Markers say which corners are where, to a pixel; what a corner is measured by is its own edges, as
on a checkerboard. OpenCV's own way from markers to a ChArUco's corners is not taken: before its
version 5 they come out half a pixel off.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.detection import Detection, NotFound
from calib.corners.local_map import LocalMap
from calib.corners.marker_links import Links
from calib.corners.markers import (
    WINDOWS_TRIED,
    Markers,
    border_of,
    marker_places,
    read_closely,
    read_markers,
)
from calib.corners.measure import Measured, measure
from calib.corners.strays import FOUND_NOISE, without_strays
from calib.session.board import Board
from calib.session.coding import AprilGrid, Charuco

Floats = NDArray[np.float64]

ADVICE = "show more of it, sharp, evenly lit and larger"
NOISE = 1.0  # px, of a marker's corners
OWN = 0.75  # sides, from a marker's middle: half a diagonal, on either kind of board
BESIDE = 1.35  # sides, from a corner that was found: how far others are looked for
BORDER = 3.0  # px of the picture, where no corner is measured
WINDOW = 0.6  # of what shows nothing but a corner's own edges: cornerSubPix's half-size
WINDOWS = (2, 10)  # px, its limits
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
AROUND = 0.6  # of what shows nothing but a corner's own edges: where its four squares are looked at
FAINT = 0.5  # of the usual contrast: less is no corner
UNLIKE = 0.5  # of the contrast, between two squares that are opposite
BEYOND_ROWS = "beyond the last row"
"""What is said of a picture in which they are: a verdict looks for it."""
BEYOND = 2
"""Markers that lie where a board with more rows has them: one may be read wrongly."""
FEWEST = 4
"""Corners or markers that tell something of others."""
# px, that a marker's side comes out shorter, as its outline goes through the middles of its
# outermost pixels
ROUNDED = 1.0
OTHER_SIZE = 0.1  # of a marker, which is seen to some hundredths
OTHER_SPACING = (
    0.02  # of a tag: measured corners tell it to thousandths, a lens bends it by one or two
)
FOUND_SPACING = 0.03  # of a tag: corners by cornerSubPix, of tags of 20 px
OUTLINE = (3, 3)  # px, cornerSubPix's half-size around the corners of a tag's outline
ROUGH_SPACING = 0.06  # of a tag: what these tell


def find_coded(grey: NDArray[np.uint8], every_bit: NDArray, board: Board) -> Detection | NotFound:
    """In a (H, W) picture: `grey` is looked at, `every_bit`, uint8 or uint16, measured."""
    rough = rough_corners(grey, board)
    if isinstance(rough, NotFound):
        return rough
    measured = _measured(every_bit, _further(rough, board, grey), board)
    if isinstance(board.coding, AprilGrid) and (
        wrong := _other_spacing(measured.corners, board, board.coding, OTHER_SPACING)
    ):
        return NotFound(wrong)
    if np.isfinite(measured.corners[:, 0]).sum() < FEWEST:
        return NotFound(f"hardly any corner of the {board} board can be measured: {ADVICE}")
    return Detection(measured.corners, measured.covariances, "coded")


def rough_corners(
    grey: NDArray[np.uint8],
    board: Board,
    windows: tuple[int, ...] = WINDOWS_TRIED,
    *,
    closely: bool = True,
) -> Floats | NotFound:
    """(count, 2) px by cornerSubPix, to a tenth, of the corners around markers that were read, NaN
    elsewhere.

    Args:
        windows: as of `read_markers`.
        closely: where markers are small, read them in an enlarged picture, too.
    """
    assert board.coding
    border = border_of(board.coding)
    read = (
        read_closely(grey, board.coding, windows)
        if closely
        else read_markers(grey, board.coding.dictionary, border, windows)
    )
    own = one_board(read, board)
    if isinstance(own, NotFound):
        return own
    if wrong := _misprint(own, board, grey):
        return NotFound(wrong)
    found = _own(own, board, grey)
    if np.isfinite(found[:, 0]).sum() < FEWEST:
        return NotFound(f"hardly any corner of the {board} board can be seen: {ADVICE}")
    if isinstance(board.coding, AprilGrid) and (
        wrong := _other_spacing(found, board, board.coding, FOUND_SPACING)
    ):
        return NotFound(wrong)
    return found


def live_corners(
    grey: NDArray[np.uint8],
    board: Board,
    windows: tuple[int, ...] = WINDOWS_TRIED,
    *,
    closely: bool = True,
) -> Floats | NotFound:
    """The same and the corners beside them.

    As none is measured, each must be where the others alone say that it is, and look like one.
    """
    rough = rough_corners(grey, board, windows, closely=closely)
    if isinstance(rough, NotFound):
        return rough
    kept = without_strays(_further(rough, board, grey), board, by_others=True)
    return _crossing(grey, kept, board) if np.isfinite(kept[:, 0]).sum() >= FEWEST else kept


def _crossing(grey: NDArray[np.uint8], corners: Floats, board: Board) -> Floats:
    """(count, 2) px, NaN where four places around a corner are not dark, light, dark, light, as two
    edges that cross leave them.
    """
    seen = np.flatnonzero(np.isfinite(corners[:, 0]))
    steps = _map(board.points()[seen], corners[seen], board, FOUND_NOISE).steps[seen] * (
        AROUND * _free(board)
    )  # (N, 2, 2) px
    around = np.stack(
        [steps.sum(1), steps[:, 0] - steps[:, 1], -steps.sum(1), steps[:, 1] - steps[:, 0]], 1
    )
    places = (corners[seen, None] + around).astype(np.float32)
    light = np.asarray(
        cv2.remap(
            grey, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        ),
        np.float64,
    )
    contrast = np.abs(light[:, ::2].sum(1) - light[:, 1::2].sum(1)) / 2
    apart = np.abs(light[:, :2] - light[:, 2:]).max(1)
    wrong = (contrast < FAINT * np.median(contrast)) | (apart > UNLIKE * contrast)
    return np.where(np.isin(np.arange(board.count), seen[wrong])[:, None], np.nan, corners)


def _measured(grey: NDArray, rough: Floats, board: Board) -> Measured:
    """Until all that are measured look like corners and lie as the others say: one that does not
    spoils the picture's noise.
    """
    while True:
        measured = measure(grey, rough, board)
        corners = without_strays(measured.corners, board)
        lost = np.isnan(corners[:, 0]) & np.isfinite(rough[:, 0])
        rough = np.where(lost[:, None], np.nan, rough)
        if not lost.any() or np.isfinite(rough[:, 0]).sum() < FEWEST:
            return Measured(
                corners, np.where(np.isnan(corners[:, :1, None]), np.nan, measured.covariances)
            )


def one_board(read: Markers, board: Board) -> Markers | NotFound:
    """Those of the markers that lie as on the board; or why they are not to be trusted."""
    places = marker_places(board)
    known = read.some((read.numbers >= 0) & (read.numbers < len(places)))
    foreign = len(read.numbers) - len(known.numbers)
    if foreign >= max(3, len(known.numbers) / 5):
        return NotFound(
            f"markers with numbers up to {read.numbers.max()} are seen, where a {board} board has 0"
            f" to {len(places) - 1}: correct columns, rows or dictionary in session.yaml, or show"
            " this board alone",
            "other",
        )
    if not len(known.numbers):
        return NotFound(f"no marker of the {board} board found: {ADVICE}", "none")
    if foreign >= BEYOND and (beyond := _beyond(read, board)) >= BEYOND:
        return NotFound(
            f"{beyond} markers are seen {BEYOND_ROWS} of the {board} board, as on one with more:"
            " correct board.rows in session.yaml",
            "other",
        )
    groups = Links.of(known, places[known.numbers], _pitch(board)).groups
    if len(groups[0]) < 2 and len(known.numbers) < FEWEST:
        return NotFound(
            f"no two markers lie as on the {board} board: {ADVICE}, or correct board in"
            " session.yaml",
            "none",
        )
    twice = _twice(known)
    if twice is not None and len(groups[0]) > 1:
        return NotFound(
            f"marker {twice} of the {board} board is seen twice: show one board alone, with each of"
            " its markers once"
        )
    if len(groups[0]) < 2 or (len(groups) > 1 and len(groups[1]) > 1):
        reason = (
            f"the markers lie not as on one {board} board: correct board in session.yaml, or show"
            " one board alone"
        )
        return NotFound(reason, "other")
    return known.some(groups[0])


def _beyond(read: Markers, board: Board) -> int:
    """How many markers lie with the board's own as on one with more rows, and are none of it."""
    own = len(marker_places(board))
    taller = replace(
        board, rows=3 * board.rows
    )  # odd where they are: a legacy pattern's first square goes by that
    places = marker_places(taller)
    some = read.some((read.numbers >= 0) & (read.numbers < len(places)))
    together = some.numbers[Links.of(some, places[some.numbers], _pitch(board)).groups[0]]
    return int((together >= own).sum()) if (together < own).any() else 0


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


def _misprint(markers: Markers, board: Board, grey: NDArray[np.uint8]) -> str:
    """A sentence, if the markers' outlines tell of another print than the declared one."""
    match board.coding:
        case Charuco():
            return _other_size(markers, board, board.coding)
        case AprilGrid():
            return _other_spacing(_tags(markers, board, grey), board, board.coding, ROUGH_SPACING)
        case None:
            return ""


def _other_size(markers: Markers, board: Board, coding: Charuco) -> str:
    """A sentence, if the markers are larger or smaller, for their distance, than declared; nothing
    where they are not, or too few.
    """
    if len(markers.numbers) < FEWEST:
        return ""
    places = marker_places(board)[markers.numbers] / board.square
    middles = places.mean(1)
    near = LocalMap.of(middles, markers.corners.mean(1), middles, NOISE)
    expected = np.einsum("nkc,ncd->nkd", places - middles[:, None], near.steps)
    part = float(np.median((markers.sides + ROUNDED) / Markers(markers.numbers, expected).sides))
    if abs(part - 1) <= OTHER_SIZE:
        return ""
    seen = (
        f"the markers are of {1e3 * part * coding.marker:.3g} mm if the squares are of"
        f" {1e3 * board.square:g}"
    )
    return (
        f"{seen}, where {1e3 * coding.marker:g} is declared: correct board.marker_mm in"
        " session.yaml"
    )


def _tags(markers: Markers, board: Board, grey: NDArray[np.uint8]) -> Floats:
    """(count, 2) px, the corners of an AprilGrid near the outlines of its tags, NaN where no tag
    was read.
    """
    places = marker_places(board)[markers.numbers].reshape(-1, 1, 2)
    corners = np.full((board.count, 2), np.nan)
    start = markers.corners.reshape(-1, 1, 2).astype(np.float32)
    moved = cv2.cornerSubPix(grey, start, OUTLINE, (-1, -1), STOP)
    corners[np.linalg.norm(board.points() - places, axis=-1).argmin(1)] = np.asarray(
        moved, np.float64
    ).reshape(-1, 2)
    return corners


def _other_spacing(corners: Floats, board: Board, coding: AprilGrid, tolerance: float) -> str:
    """The same of the distance between tags."""
    grid = corners.reshape(board.rows, board.columns, 2)
    found = []
    for lines in (grid, grid.swapaxes(0, 1)):
        lengths = np.linalg.norm(np.diff(lines, axis=1), axis=-1)  # px of a tag, a gap, a tag, ...
        found.append((2 * lengths[:, 1::2] / (lengths[:, :-1:2] + lengths[:, 2::2])).ravel())
    parts = np.concatenate(found)
    parts = parts[np.isfinite(parts)]
    if len(parts) < FEWEST or abs(np.median(parts) - coding.spacing) <= tolerance:
        return ""
    seen = (
        f"the tags are {np.median(parts):.2f} of their side apart, where {coding.spacing:g} is"
        " declared"
    )
    return f"{seen}: correct board.spacing in session.yaml"


def _own(markers: Markers, board: Board, grey: NDArray[np.uint8]) -> Floats:
    """(count, 2) px, the corners around the markers that were read; NaN elsewhere."""
    places = marker_places(board)[markers.numbers]
    near = _map(places.reshape(-1, 2), markers.corners.reshape(-1, 2), board, NOISE)
    return _refined(grey, near, _within(board, places.mean(1), OWN), board)


def _further(found: Floats, board: Board, grey: NDArray[np.uint8]) -> Floats:
    """The same, and corners beside them whose markers were not read: outside of the picture in
    part, or covered.
    """
    seen = np.isfinite(found[:, 0])
    near = _map(board.points()[seen], found[seen], board, FOUND_NOISE)
    wanted = ~seen & _within(board, board.points()[seen], BESIDE)
    return np.where(seen[:, None], found, _refined(grey, near, wanted, board))


def _within(board: Board, places: Floats, sides: float) -> NDArray[np.bool_]:
    """(count,) whether a corner is so near to one of (N, 2) m."""
    return np.asarray(
        np.linalg.norm(board.points()[:, None] - places, axis=-1).min(1) <= sides * board.square
    )


def _map(places: Floats, pixels: Floats, board: Board, noise: float) -> LocalMap:
    """At the board's corners, from (N, 2) m and px."""
    unit = 2 * board.half[0] / (board.columns - 1)
    return LocalMap.of(places / unit, pixels, board.points() / unit, noise)


def _free(board: Board) -> float:
    """Of the distance of two corners in the mean: what of it, around a corner, shows its own two
    edges alone.
    """
    match board.coding:
        case AprilGrid(spacing):
            return min(spacing, 0.2) * board.square / (2 * board.half[0] / (board.columns - 1))
        case Charuco(marker):
            return (1 - marker / board.square) / 2
        case None:
            return 0.5


def _refined(
    grey: NDArray[np.uint8], near: LocalMap, wanted: NDArray[np.bool_], board: Board
) -> Floats:
    """(count, 2) px by cornerSubPix; NaN where that leads away, outside of the picture, and where
    it is not wanted.
    """
    found = np.full_like(near.pixels, np.nan)
    inside = (
        (near.pixels >= BORDER) & (near.pixels <= np.array(grey.shape[::-1]) - 1 - BORDER)
    ).all(1)
    halves = np.clip(
        WINDOW * _free(board) * np.linalg.norm(near.steps, axis=-1).min(1), *WINDOWS
    ).astype(int)
    for half in np.unique(halves[wanted & inside]).tolist():
        own = np.flatnonzero(wanted & inside & (halves == half))
        start = near.pixels[own].reshape(-1, 1, 2).astype(np.float32)
        moved = np.asarray(
            cv2.cornerSubPix(grey, start, (half, half), (-1, -1), STOP), np.float64
        ).reshape(-1, 2)
        stays = np.linalg.norm(moved - near.pixels[own], axis=1) <= half + 1
        found[own[stays]] = moved[stays]
    return without_strays(found, board)

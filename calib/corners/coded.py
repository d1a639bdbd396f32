"""Find the corners of a board with markers, or of the part of it that a picture shows.

The markers identify the corners and locate them to a pixel. Each corner is then measured by its own
edges, as on a checkerboard. OpenCV's own step from markers to the corners of a ChArUco board is not
used: before version 5 it returns corners that are half a pixel off.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.detection import Detection, NotFound
from calib.corners.local_map import LocalMap
from calib.corners.marker_links import group_markers
from calib.corners.markers import (
    THRESHOLD_WINDOWS,
    Markers,
    border_of,
    marker_cells,
    marker_places,
    read_markers,
    read_small_markers,
)
from calib.corners.measure import MeasuredCorners, measure_corners
from calib.corners.outlier_corners import CORNER_NOISE, remove_outlier_corners
from calib.corners.tag_outline import edge_vectors, measure_outlines
from calib.session.board import Board
from calib.session.coding import AprilGrid, Charuco

Floats = NDArray[np.float64]

MARKER_ADVICE = "show more of it, sharp, evenly lit and larger"
MARKER_NOISE = 1.0  # px, of a marker's corners
MARKER_RADIUS = 0.75  # sides, from a marker's middle: half a diagonal, on either kind of board
NEIGHBOUR_RADIUS = 1.35  # sides, from a located corner: how far other corners are looked for
PICTURE_BORDER = 3.0  # px at the picture's rim, where no corner is measured
# of the distance around a corner within which only its own edges are visible:
WINDOW = 0.6  # cornerSubPix's half-size
SQUARE_SAMPLE = 0.6  # where the four squares around the corner are sampled
WINDOW_LIMITS = (2, 10)  # px
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
MIN_CONTRAST = 0.5  # of the usual contrast: less is no corner
MAX_DIFFERENCE = 0.5  # of the contrast, between two squares that are opposite
PAST_LAST_ROW = "beyond the last row"
"""The reason for rejecting a picture with markers there contains this phrase; the verdict looks for
it.
"""
MIN_MARKERS_PAST_LAST_ROW = 2
"""Markers at places that only a board with more rows has: a single one may be misread."""
MIN_COUNT = 4
"""Corners or markers that are needed to conclude anything from them about others."""
# px that a marker's side is measured too short: its outline runs through the middles of its
# outermost pixels
OUTLINE_LOSS = 1.0
SIZE_TOLERANCE = 0.1  # of a marker: its size is measured to some hundredths
# The tolerances of an AprilGrid's spacing, in parts of a tag's side. Measured corners determine it
# to thousandths; a lens changes it by one or two hundredths.
MEASURED_SPACING_TOLERANCE = 0.02
LOCATED_SPACING_TOLERANCE = 0.03  # with corners by cornerSubPix, for tags of 20 px
OUTLINE_SPACING_TOLERANCE = 0.06  # with the corners of the tags' outlines
OUTLINE_WINDOW = (3, 3)  # px, cornerSubPix's half-size around the corners of a tag's outline


def find_coded_board(
    grey: NDArray[np.uint8], every_bit: NDArray, board: Board
) -> Detection | NotFound:
    """Find and measure the corners of a board with markers.

    Args:
        grey: (H, W), the picture in which markers and corners are located.
        every_bit: (H, W) uint8 or uint16, the picture in which corners are measured.
        board: the board.
    """
    located = locate_corners(grey, board)
    if isinstance(located, NotFound):
        return located
    measured = (
        _measure_tags(every_bit, located, board, board.coding)
        if isinstance(board.coding, AprilGrid) and not board.coding.crossings
        else _measure_consistent_corners(every_bit, _add_neighbours(located, board, grey), board)
    )
    if isinstance(board.coding, AprilGrid) and (
        problem := _describe_other_spacing(
            measured.corners, board, board.coding, MEASURED_SPACING_TOLERANCE
        )
    ):
        return NotFound(problem)
    if np.isfinite(measured.corners[:, 0]).sum() < MIN_COUNT:
        return NotFound(f"hardly any corner of the {board} board can be measured: {MARKER_ADVICE}")
    return Detection(measured.corners, measured.covariances, measured.blurs, "coded")


def locate_corners(
    grey: NDArray[np.uint8],
    board: Board,
    windows: tuple[int, ...] = THRESHOLD_WINDOWS,
    *,
    enlarge: bool = True,
) -> Floats | NotFound:
    """Return (count, 2) px, the corners around the markers that were read, by cornerSubPix to a
    tenth of a pixel; NaN elsewhere.

    Args:
        grey: (H, W).
        board: the board.
        windows: as in `read_markers`.
        enlarge: read small markers in an enlarged picture, too.
    """
    assert board.coding
    border = border_of(board.coding)
    if board.coding.inverted:
        grey = np.asarray(cv2.bitwise_not(grey), np.uint8)
    markers = (
        read_small_markers(grey, board.coding, windows)
        if enlarge
        else read_markers(grey, board.coding.dictionary, border, windows)
    )
    board_markers = select_board_markers(markers, board)
    if isinstance(board_markers, NotFound):
        return board_markers
    corners = _locate_marker_corners(board_markers, board, grey)
    problem = _describe_misprint(board_markers, board, grey)
    if problem and not _has_declared_spacing(corners, board):
        return NotFound(problem)
    if np.isfinite(corners[:, 0]).sum() < MIN_COUNT:
        return NotFound(f"hardly any corner of the {board} board can be seen: {MARKER_ADVICE}")
    if isinstance(board.coding, AprilGrid) and (
        problem := _describe_other_spacing(corners, board, board.coding, LOCATED_SPACING_TOLERANCE)
    ):
        return NotFound(problem)
    return corners


def locate_live_corners(
    grey: NDArray[np.uint8],
    board: Board,
    windows: tuple[int, ...] = THRESHOLD_WINDOWS,
    *,
    enlarge: bool = True,
) -> Floats | NotFound:
    """Return (count, 2) px, the corners of `locate_corners` and their neighbours.

    None of them is measured. So each must lie where its neighbours alone predict it, and look like
    a corner.
    """
    located = locate_corners(grey, board, windows, enlarge=enlarge)
    if isinstance(located, NotFound):
        return located
    inliers = remove_outlier_corners(
        _add_neighbours(located, board, grey), board, by_neighbours=True
    )
    return (
        _keep_crossings(grey, inliers, board)
        if np.isfinite(inliers[:, 0]).sum() >= MIN_COUNT
        else inliers
    )


def _keep_crossings(grey: NDArray[np.uint8], corners: Floats, board: Board) -> Floats:
    """Set corners to NaN unless the four squares around them are dark, light, dark, light, as two
    crossing edges leave them.
    """
    visible = np.flatnonzero(np.isfinite(corners[:, 0]))
    steps = _fit_map(board.points()[visible], corners[visible], board, CORNER_NOISE).steps[
        visible
    ] * (SQUARE_SAMPLE * _undisturbed_distance(board))  # (N, 2, 2) px
    offsets = np.stack(
        [steps.sum(1), steps[:, 0] - steps[:, 1], -steps.sum(1), steps[:, 1] - steps[:, 0]], 1
    )
    places = (corners[visible, None] + offsets).astype(np.float32)
    light = np.asarray(
        cv2.remap(
            grey, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        ),
        np.float64,
    )
    contrast = np.abs(light[:, ::2].sum(1) - light[:, 1::2].sum(1)) / 2
    difference = np.abs(light[:, :2] - light[:, 2:]).max(1)
    rejected = (contrast < MIN_CONTRAST * np.median(contrast)) | (
        difference > MAX_DIFFERENCE * contrast
    )
    return np.where(np.isin(np.arange(board.count), visible[rejected])[:, None], np.nan, corners)


def _measure_consistent_corners(grey: NDArray, located: Floats, board: Board) -> MeasuredCorners:
    """Measure the corners, repeatedly without those that do not look like corners or do not lie
    where their neighbours predict them: such a corner distorts the estimate of the picture's noise.
    """
    while True:
        measured = measure_corners(grey, located, board)
        corners = remove_outlier_corners(measured.corners, board)
        removed = np.isnan(corners[:, 0]) & np.isfinite(located[:, 0])
        located = np.where(removed[:, None], np.nan, located)
        if not removed.any() or np.isfinite(located[:, 0]).sum() < MIN_COUNT:
            return MeasuredCorners(
                corners,
                np.where(np.isnan(corners[:, :1, None]), np.nan, measured.covariances),
                np.where(np.isnan(corners), np.nan, measured.blurs),
            )


def _measure_tags(
    grey: NDArray, located: Floats, board: Board, coding: AprilGrid
) -> MeasuredCorners:
    """Measure the corners of the tags of which all four are located, where the edges of their
    outlines meet. Between two corners, an edge bends as the board around it does.
    """
    if coding.inverted:
        grey = np.asarray(np.iinfo(grey.dtype).max - grey, grey.dtype)
    order = np.arange(board.count).reshape(board.rows // 2, 2, board.columns // 2, 2)
    clockwise = order.swapaxes(1, 2).reshape(-1, 4)[:, [0, 1, 3, 2]]  # (tags, 4)
    complete = clockwise[np.isfinite(located[clockwise][..., 0]).all(1)]
    corners = np.full((board.count, 2), np.nan)
    covariances = np.full((board.count, 2, 2), np.nan)
    blurs = np.full((board.count, 2), np.nan)
    if not len(complete):
        return MeasuredCorners(corners, covariances, blurs)
    rough = located[complete]
    following = np.roll(complete, -1, 1)
    unit = 2 * board.half[0] / (board.columns - 1)
    visible = np.isfinite(located[:, 0])
    middles = (board.points()[complete] + board.points()[following]).reshape(-1, 2) / 2
    bent = LocalMap.fit(
        board.points()[visible] / unit, located[visible], middles / unit, CORNER_NOISE, cubic=True
    )
    straight = (rough + np.roll(rough, -1, 1)) / 2
    _, normals = edge_vectors(rough)
    bends = ((bent.pixels.reshape(straight.shape) - straight) * normals).sum(-1)
    outlines = measure_outlines(grey, rough, marker_cells(coding), bends)
    corners[complete] = outlines.corners
    blocks = outlines.covariances.reshape(-1, 4, 2, 4, 2)
    covariances[complete] = np.stack([blocks[:, k, :, k] for k in range(4)], 1)
    # from each corner to the next: along the row, the column, the row, the column
    before = np.roll(outlines.blurs, 1, 1)
    along_row = np.where([True, False, True, False], outlines.blurs, before)
    along_column = np.where([True, False, True, False], before, outlines.blurs)
    blurs[complete] = np.stack([along_row, along_column], -1)
    kept = np.isfinite(remove_outlier_corners(corners, board)[:, 0])
    return MeasuredCorners(
        np.where(kept[:, None], corners, np.nan),
        np.where(kept[:, None, None], covariances, np.nan),
        np.where(kept[:, None], blurs, np.nan),
    )


def select_board_markers(markers: Markers, board: Board) -> Markers | NotFound:
    """Return the markers that lie as on the board, with numbers that count from its first marker,
    or the reason not to trust any of them.
    """
    assert board.coding
    first = board.coding.first_marker
    markers = Markers(markers.numbers - first, markers.corners)
    places = marker_places(board)
    identified = markers.select((markers.numbers >= 0) & (markers.numbers < len(places)))
    foreign = len(markers.numbers) - len(identified.numbers)
    if foreign >= max(3, len(identified.numbers) / 5):
        return NotFound(
            f"markers with numbers up to {markers.numbers.max() + first} are seen, where a {board}"
            f" board has {first} to {first + len(places) - 1}: correct columns, rows, first_marker"
            " or dictionary in session.yaml, or show this board alone",
            "other",
        )
    if not len(identified.numbers):
        return NotFound(f"no marker of the {board} board found: {MARKER_ADVICE}", "none")
    if (
        foreign >= MIN_MARKERS_PAST_LAST_ROW
        and (past_last_row := _count_markers_past_last_row(markers, board))
        >= MIN_MARKERS_PAST_LAST_ROW
    ):
        return NotFound(
            f"{past_last_row} markers are seen {PAST_LAST_ROW} of the {board} board, as on one with"
            " more: correct board.rows in session.yaml",
            "other",
        )
    groups = group_markers(identified, places[identified.numbers], _marker_pitch(board))
    if len(groups[0]) < 2 and len(identified.numbers) < MIN_COUNT:
        return NotFound(
            f"no two markers lie as on the {board} board: {MARKER_ADVICE}, or correct board in"
            " session.yaml",
            "none",
        )
    repeated = _find_repeated_number(identified)
    if repeated is not None and len(groups[0]) > 1:
        return NotFound(
            f"marker {repeated + first} of the {board} board is seen twice: show one board alone,"
            " with each of its markers once"
        )
    if len(groups[0]) < 2 or (len(groups) > 1 and len(groups[1]) > 1):
        reason = (
            f"the markers do not lie as on one {board} board: correct board in session.yaml, or"
            " show one board alone"
        )
        return NotFound(reason, "other")
    return identified.select(groups[0])


def _count_markers_past_last_row(markers: Markers, board: Board) -> int:
    """Count the markers that this board lacks, but that lie beside its own as on a taller board."""
    count = len(marker_places(board))
    # three times keep the rows odd or even: a legacy pattern's first square depends on that
    taller = replace(board, rows=3 * board.rows)
    places = marker_places(taller)
    identified = markers.select((markers.numbers >= 0) & (markers.numbers < len(places)))
    groups = group_markers(identified, places[identified.numbers], _marker_pitch(board))
    linked = identified.numbers[groups[0]]
    return int((linked >= count).sum()) if (linked < count).any() else 0


def _marker_pitch(board: Board) -> float:
    """Return the distance of neighbouring markers, m."""
    match board.coding:
        case AprilGrid(spacing):
            return (1 + spacing) * board.square
        case _:
            return 2**0.5 * board.square


def _find_repeated_number(markers: Markers) -> int | None:
    """Return a marker number that is read at two places."""
    for number in np.unique(markers.numbers):
        same = markers.select(markers.numbers == number)
        middles = same.corners.mean(1)
        if (np.linalg.norm(middles - middles[0], axis=-1) > same.sides.min() / 2).any():
            return int(number)
    return None


def _describe_misprint(markers: Markers, board: Board, grey: NDArray[np.uint8]) -> str:
    """Return a sentence if the markers' outlines show that another board was printed than the
    declared one.
    """
    match board.coding:
        case Charuco():
            return _describe_other_size(markers, board, board.coding)
        case AprilGrid():
            return _describe_other_spacing(
                refine_tag_outlines(markers, board, grey),
                board,
                board.coding,
                OUTLINE_SPACING_TOLERANCE,
            )
        case None:
            return ""


def _describe_other_size(markers: Markers, board: Board, coding: Charuco) -> str:
    """Return a sentence if the markers are larger or smaller, relative to their distance, than
    declared; "" if they are not, or if there are too few.
    """
    ratio = measure_marker_size(markers, board)
    if ratio is None or abs(ratio - 1) <= SIZE_TOLERANCE:
        return ""
    finding = (
        f"the markers are of {1e3 * ratio * coding.marker:.3g} mm if the squares are of"
        f" {1e3 * board.square:g}"
    )
    return (
        f"{finding}, where {1e3 * coding.marker:g} is declared: correct board.marker_mm in"
        " session.yaml"
    )


def measure_marker_size(markers: Markers, board: Board) -> float | None:
    """Return the size of a board's markers, relative to their distance, in parts of the declared
    one; None if there are too few of them.
    """
    if len(markers.numbers) < MIN_COUNT:
        return None
    places = marker_places(board)[markers.numbers] / board.square
    middles = places.mean(1)
    local_map = LocalMap.fit(middles, markers.corners.mean(1), middles, MARKER_NOISE)
    expected = np.einsum("nkc,ncd->nkd", places - middles[:, None], local_map.steps)
    sides = Markers(markers.numbers, expected).sides
    return float(np.median((markers.sides + OUTLINE_LOSS) / sides))


def refine_tag_outlines(markers: Markers, board: Board, grey: NDArray[np.uint8]) -> Floats:
    """Return (count, 2) px, an AprilGrid's corners refined near the outlines of its tags, NaN where
    no tag was read.
    """
    places = marker_places(board)[markers.numbers].reshape(-1, 1, 2)
    corners = np.full((board.count, 2), np.nan)
    start = markers.corners.reshape(-1, 1, 2).astype(np.float32)
    refined = cv2.cornerSubPix(grey, start, OUTLINE_WINDOW, (-1, -1), STOP)
    corners[np.linalg.norm(board.points() - places, axis=-1).argmin(1)] = np.asarray(
        refined, np.float64
    ).reshape(-1, 2)
    return corners


def _has_declared_spacing(corners: Floats, board: Board) -> bool:
    """Return True if the (count, 2) px corners show an AprilGrid with the declared spacing. The
    outlines alone may be wrong: a threshold with a small window cuts off a part of a tag's border.
    """
    if not isinstance(board.coding, AprilGrid):
        return False
    spacing = measure_spacing(corners, board)
    return spacing is not None and abs(spacing - board.coding.spacing) <= LOCATED_SPACING_TOLERANCE


def _describe_other_spacing(
    corners: Floats, board: Board, coding: AprilGrid, tolerance: float
) -> str:
    """Return a sentence if the distance between the tags is not as declared; "" if it is, or if too
    few are visible.
    """
    spacing = measure_spacing(corners, board)
    if spacing is None or abs(spacing - coding.spacing) <= tolerance:
        return ""
    finding = (
        f"the tags are {spacing:.2f} of their side apart, where {coding.spacing:g} is declared"
    )
    return f"{finding}: correct board.spacing in session.yaml"


def measure_spacing(corners: Floats, board: Board) -> float | None:
    """Return the gap between the tags of an AprilGrid, in sides of a tag, from its (count, 2) px
    corners; None if too few are visible.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    ratios_by_direction = []
    for lines in (grid, grid.swapaxes(0, 1)):
        lengths = np.linalg.norm(np.diff(lines, axis=1), axis=-1)  # px of a tag, a gap, a tag, ...
        ratios = 2 * lengths[:, 1::2] / (lengths[:, :-1:2] + lengths[:, 2::2])
        ratios_by_direction.append(ratios.ravel())
    ratios = np.concatenate(ratios_by_direction)
    ratios = ratios[np.isfinite(ratios)]
    return float(np.median(ratios)) if len(ratios) >= MIN_COUNT else None


def _locate_marker_corners(markers: Markers, board: Board, grey: NDArray[np.uint8]) -> Floats:
    """Return (count, 2) px, the corners around the given markers, NaN elsewhere."""
    places = marker_places(board)[markers.numbers]
    local_map = _fit_map(places.reshape(-1, 2), markers.corners.reshape(-1, 2), board, MARKER_NOISE)
    return _refine_corners(grey, local_map, _is_within(board, places.mean(1), MARKER_RADIUS), board)


def _add_neighbours(located: Floats, board: Board, grey: NDArray[np.uint8]) -> Floats:
    """Return the located corners and their neighbours, whose markers were not read because they are
    partly covered or outside the picture.
    """
    visible = np.isfinite(located[:, 0])
    local_map = _fit_map(board.points()[visible], located[visible], board, CORNER_NOISE)
    requested = ~visible & _is_within(board, board.points()[visible], NEIGHBOUR_RADIUS)
    return np.where(visible[:, None], located, _refine_corners(grey, local_map, requested, board))


def _is_within(board: Board, places: Floats, sides: float) -> NDArray[np.bool_]:
    """Return (count,), true where a corner lies within so many sides of one of the (N, 2) m
    places.
    """
    return np.asarray(
        np.linalg.norm(board.points()[:, None] - places, axis=-1).min(1) <= sides * board.square
    )


def _fit_map(places: Floats, pixels: Floats, board: Board, noise: float) -> LocalMap:
    """Fit a local map at the board's corners, from (N, 2) m places and their (N, 2) px."""
    unit = 2 * board.half[0] / (board.columns - 1)
    return LocalMap.fit(places / unit, pixels, board.points() / unit, noise)


def _undisturbed_distance(board: Board) -> float:
    """Return the distance around a corner within which only its own two edges are visible, in parts
    of the mean distance of two corners.
    """
    match board.coding:
        case AprilGrid(spacing) as coding:
            tag_border = border_of(coding) / marker_cells(coding)
            return (
                min(spacing, tag_border) * board.square / (2 * board.half[0] / (board.columns - 1))
            )
        case Charuco(marker):
            return (1 - marker / board.square) / 2
        case None:
            return 0.5


def _refine_corners(
    grey: NDArray[np.uint8], local_map: LocalMap, requested: NDArray[np.bool_], board: Board
) -> Floats:
    """Return (count, 2) px by cornerSubPix; NaN where it leads away from the map's prediction,
    outside the picture, and where no corner is requested.
    """
    corners = np.full_like(local_map.pixels, np.nan)
    interior = (
        (local_map.pixels >= PICTURE_BORDER)
        & (local_map.pixels <= np.array(grey.shape[::-1]) - 1 - PICTURE_BORDER)
    ).all(1)
    halves = np.clip(
        WINDOW * _undisturbed_distance(board) * np.linalg.norm(local_map.steps, axis=-1).min(1),
        *WINDOW_LIMITS,
    ).astype(int)
    for half in np.unique(halves[requested & interior]).tolist():
        index = np.flatnonzero(requested & interior & (halves == half))
        start = local_map.pixels[index].reshape(-1, 1, 2).astype(np.float32)
        refined = np.asarray(
            cv2.cornerSubPix(grey, start, (half, half), (-1, -1), STOP), np.float64
        ).reshape(-1, 2)
        converged = np.linalg.norm(refined - local_map.pixels[index], axis=1) <= half + 1
        corners[index[converged]] = refined[converged]
    return remove_outlier_corners(corners, board)

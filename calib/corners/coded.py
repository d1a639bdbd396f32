"""Find the corners of a board with markers, or of the part of it that a picture shows.

The markers identify the corners and locate them to a pixel. Each corner is then measured by its own
edges, as on a checkerboard. OpenCV's own step from markers to the corners of a ChArUco board is not
used: before version 5 it returns corners that are half a pixel off.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.board_markers import MARKER_ADVICE, MIN_COUNT, select_board_markers
from calib.corners.detection import Detection, NotFound
from calib.corners.local_map import LocalMap
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
from calib.corners.misprint import (
    LOCATED_SPACING_TOLERANCE,
    MARKER_NOISE,
    MEASURED_SPACING_TOLERANCE,
    STOP,
    describe_misprint,
    describe_other_spacing,
    has_declared_spacing,
)
from calib.corners.outlier_corners import CORNER_NOISE, remove_outlier_corners
from calib.corners.tag_outline import edge_vectors, measure_outlines
from calib.session.board import Board
from calib.session.coding import AprilGrid, Charuco

Floats = NDArray[np.float64]

MARKER_RADIUS = 0.75
"""Sides, from a marker's middle: half a diagonal, on either kind of board."""
NEIGHBOUR_RADIUS = 1.35
"""Sides, from a located corner: how far other corners are looked for."""
PICTURE_BORDER = 3.0
"""px at the picture's rim, where no corner is measured."""
WINDOW = 0.6
"""cornerSubPix's half-size, in parts of the distance around a corner within which only its own
edges are visible.
"""
SQUARE_SAMPLE = 0.6
"""The place, in parts of the same distance, where the four squares around a corner are sampled."""
WINDOW_LIMITS = (2, 10)
"""px"""
MIN_CONTRAST = 0.5
"""Of the usual contrast: less is no corner."""
MAX_DIFFERENCE = 0.5
"""Of the contrast, between two squares that are opposite."""


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
        problem := describe_other_spacing(
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
    problem = describe_misprint(board_markers, board, grey)
    if problem and not has_declared_spacing(corners, board):
        return NotFound(problem)
    if np.isfinite(corners[:, 0]).sum() < MIN_COUNT:
        return NotFound(f"hardly any corner of the {board} board can be seen: {MARKER_ADVICE}")
    if isinstance(board.coding, AprilGrid) and (
        problem := describe_other_spacing(corners, board, board.coding, LOCATED_SPACING_TOLERANCE)
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

"""Find out from a picture whether another board was printed than the declared one: the size of a
ChArUco's markers, or the gaps between an AprilGrid's tags.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.board_markers import MIN_COUNT
from calib.corners.local_map import LocalMap
from calib.corners.markers import Markers, marker_places
from calib.session.board import Board
from calib.session.coding import AprilGrid, Charuco

Floats = NDArray[np.float64]

MARKER_NOISE = 1.0
"""px, of a marker's corners."""
OUTLINE_LOSS = 1.0
"""px that a marker's side is measured too short: its outline runs through the middles of its
outermost pixels.
"""
SIZE_TOLERANCE = 0.1
"""Of a marker: its size is measured to some hundredths."""
MEASURED_SPACING_TOLERANCE = 0.02
"""The tolerance of an AprilGrid's spacing, in parts of a tag's side, with measured corners. They
determine it to thousandths; a lens changes it by one or two hundredths.
"""
LOCATED_SPACING_TOLERANCE = 0.03
"""The same with corners by cornerSubPix, for tags of 20 px."""
OUTLINE_SPACING_TOLERANCE = 0.06
"""The same with the corners of the tags' outlines."""
OUTLINE_WINDOW = (3, 3)
"""px, cornerSubPix's half-size around the corners of a tag's outline."""
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
"""The end of cornerSubPix."""


def describe_misprint(markers: Markers, board: Board, grey: NDArray[np.uint8]) -> str:
    """Return a sentence if the markers' outlines show that another board was printed than the
    declared one.
    """
    match board.coding:
        case Charuco():
            return _describe_other_size(markers, board, board.coding)
        case AprilGrid():
            return describe_other_spacing(
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


def has_declared_spacing(corners: Floats, board: Board) -> bool:
    """Return True if the (count, 2) px corners show an AprilGrid with the declared spacing. The
    outlines alone may be wrong: a threshold with a small window cuts off a part of a tag's border.
    """
    if not isinstance(board.coding, AprilGrid):
        return False
    spacing = measure_spacing(corners, board)
    return spacing is not None and abs(spacing - board.coding.spacing) <= LOCATED_SPACING_TOLERANCE


def describe_other_spacing(
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

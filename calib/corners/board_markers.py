"""Decide which of the markers that were read in a picture belong to the board, from their numbers
and from the way in which they lie.
"""

from dataclasses import replace

import numpy as np

from calib.corners.detection import NotFound
from calib.corners.marker_links import group_markers
from calib.corners.markers import Markers, marker_places
from calib.session.board import Board
from calib.session.coding import AprilGrid

MARKER_ADVICE = "show more of it, sharp, evenly lit and larger"
PAST_LAST_ROW = "beyond the last row"
"""The reason for rejecting a picture with markers there contains this phrase; the verdict looks for
it.
"""
MIN_MARKERS_PAST_LAST_ROW = 2
"""Markers at places that only a board with more rows has: a single one may be misread."""
MIN_COUNT = 4
"""Corners or markers that are needed to conclude anything from them about others."""


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

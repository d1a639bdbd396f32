"""Pictures in which a declared board with markers is not -> which one is, as far as its markers
tell.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.coded import one_board
from calib.corners.detection import NotFound
from calib.corners.markers import Markers, border_of, read_markers
from calib.session.board import Board
from calib.session.coding import DICTIONARIES, AprilGrid, Charuco

KALIBR = AprilGrid(0.3)
FAMILIES = (
    *(
        (name, 1)
        for name, count in DICTIONARIES.items()
        if count == 1000 or not name.startswith(tuple(f"DICT_{n}X" for n in "4567"))
    ),
    (KALIBR.dictionary, border_of(KALIBR)),
)
"""Dictionaries that begin alike with the largest alone, and how wide their markers' borders are,
cells.
"""
ALL_BUT_ERRORS = 0.9
"""Of the numbers."""
LINKED = 0.8
"""Of the markers in a picture: another board must explain so many, where two boards in one picture
would explain the rest.
"""
FEWEST = 3
"""Markers in a picture that are no accident."""
CLEAR = 4 * FEWEST
"""Markers of one family: it is there."""
ACCIDENT = 0.3
"""Of its number: so many markers of another family may be read where there are none."""
MOST_COLUMNS = 40
PARTS = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4)
"""Of a square: markers, which are linked if they are declared to a tenth."""

Pictures = Sequence[NDArray[np.uint8]]


def other_coding(pictures: Pictures, board: Board) -> str:
    """A sentence with what to write or do, or nothing."""
    coding = board.coding
    assert coding
    read = [read_markers(picture, coding.dictionary, border_of(coding)) for picture in pictures]
    if _fit(read, board):
        return ""
    if said := _other_places(read, board):
        return said
    flipped = [
        read_markers(np.ascontiguousarray(picture[:, ::-1]), coding.dictionary, border_of(coding))
        for picture in pictures
    ]
    if _fit(flipped, board):
        return (
            f"the markers of the {board} board can be read in a mirror alone: turn the pictures'"
            " mirroring off, or print the board anew."
        )
    name, cells, numbers = _most_seen(pictures)
    if len(numbers) <= max(
        FEWEST, FEWEST * len(pictures) / 2, 2 * sum(len(markers.numbers) for markers in read)
    ):
        return ""
    alike = [
        other
        for other in DICTIONARIES
        if other.rpartition("_")[0] == name.rpartition("_")[0] and name.endswith("_1000")
    ] or [name]
    smallest = next(
        other
        for other in alike
        if other == name or np.mean(numbers < DICTIONARIES[other]) > ALL_BUT_ERRORS
    )
    border = "one cell" if cells == 1 else "two cells"
    said = (
        f"the pictures show markers of {smallest} with a black border of {border}, where the"
        f" declared {board} board has those of"
    )
    return f"{said} {coding.dictionary}: correct board in session.yaml."


def _most_seen(pictures: Pictures) -> tuple[str, int, NDArray[np.int64]]:
    """The family of which most markers are read, its border, and the (N,) numbers. Once one is
    clearly there, no other is looked for that
    is not: a picture takes a third of a second for each.
    """
    seen = {family: np.zeros(0, np.int64) for family in FAMILIES}
    for picture in pictures:
        seen = {
            family: np.append(numbers, read_markers(picture, *family).numbers)
            for family, numbers in seen.items()
        }
        most = max(map(len, seen.values()))
        if most >= CLEAR:
            seen = {
                family: numbers
                for family, numbers in seen.items()
                if len(numbers) > ACCIDENT * most
            }
    name, cells = max(seen, key=lambda family: len(seen[family]))
    return name, cells, seen[name, cells]


def _other_places(read: Sequence[Markers], board: Board) -> str:
    """The markers can be read, but lie not as declared."""
    if isinstance(board.coding, Charuco):
        legacy = board.coding.legacy_pattern
        if board.rows % 2 and _fit(
            read, replace(board, coding=replace(board.coding, legacy_pattern=not legacy)), LINKED
        ):
            kind, write = ("new", "false") if legacy else ("legacy", "true")
            return (
                f"the markers lie as on a board of the {kind} pattern: write board.legacy_pattern:"
                f" {write} in session.yaml."
            )
        for part in PARTS:
            if _fit(
                read,
                replace(board, coding=replace(board.coding, marker=part * board.square)),
                LINKED,
            ):
                return (
                    f"the markers are of about {part:.1f} of a square: correct board.marker_mm in"
                    " session.yaml."
                )
    corners = 2 if isinstance(board.coding, AprilGrid) else 1
    for columns in range(2, MOST_COLUMNS):
        if _fit(read, replace(board, columns=corners * columns), LINKED):
            return (
                f"the markers lie as on a board with {columns} columns, not as on {board}: write"
                f" board.columns: {columns} in session.yaml."
            )
    return ""


def _fit(read: Sequence[Markers], board: Board, linked: float = 0.0) -> bool:
    """Whether in most pictures such a part of the markers, and enough of them, lie as on this
    board, or on one with more rows.
    """
    most = 1 + max(int(markers.numbers.max(initial=0)) for markers in read)
    taller = replace(board, rows=board.rows + 2 * most)

    def holds(markers: Markers) -> bool:
        own = one_board(markers, taller)
        return not isinstance(own, NotFound) and len(own.numbers) >= linked * len(markers.numbers)

    return _most(read, holds)


def _most(read: Sequence[Markers], holds: Callable[[Markers], bool]) -> bool:
    return 2 * sum(map(holds, read)) >= len(read)

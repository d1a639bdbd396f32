"""Identify the board with markers that the pictures show in place of the declared one, as far as
its markers allow.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.coded import select_board_markers
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
"""Dictionaries, each with the width of its markers' borders in cells. Dictionaries that start alike
are represented by the largest.
"""
MIN_VALID_FRACTION = 0.9
"""Part of the numbers that a dictionary must contain: the others may be reading errors."""
MIN_LINKED_FRACTION = 0.8
"""Part of a picture's markers that another board must explain: two boards in one picture would each
explain less.
"""
MIN_MARKERS = 3
"""Markers in a picture that cannot be read by chance."""
CLEAR_COUNT = 4 * MIN_MARKERS
"""Markers of one family that prove it is present."""
CHANCE_FRACTION = 0.3
"""Part of a family's count that markers of an absent family may reach by misreading."""
MAX_COLUMNS = 40
MARKER_FRACTIONS = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4)
"""Marker sizes to try, in parts of a square: markers are linked if their size is declared to a
tenth.
"""

Pictures = Sequence[NDArray[np.uint8]]


def other_coding(pictures: Pictures, board: Board) -> str:
    """Return a sentence that says what to correct, or "" if no other board is recognised."""
    coding = board.coding
    assert coding
    border = border_of(coding)
    markers = [read_markers(picture, coding.dictionary, border) for picture in pictures]
    if _fits(markers, board):
        return ""
    if advice := _describe_other_layout(markers, board):
        return advice
    mirrored_markers = [
        read_markers(np.ascontiguousarray(picture[:, ::-1]), coding.dictionary, border)
        for picture in pictures
    ]
    if _fits(mirrored_markers, board):
        return (
            f"the markers of the {board} board can be read only in a mirror: turn the pictures'"
            " mirroring off, or print the board anew."
        )
    name, cells, numbers = most_frequent_family(pictures)
    if len(numbers) <= max(
        MIN_MARKERS,
        MIN_MARKERS * len(pictures) / 2,
        2 * sum(len(picture.numbers) for picture in markers),
    ):
        return ""
    smallest = smallest_dictionary(name, numbers)
    width = "one cell" if cells == 1 else "two cells"
    return (
        f"the pictures show markers of {smallest} with a black border of {width}, where the"
        f" declared {board} board has those of {coding.dictionary}: correct board in session.yaml."
    )


def smallest_dictionary(name: str, numbers: NDArray[np.int64]) -> str:
    """Return the smallest dictionary that begins as `name` does and has nearly all of the (N,)
    numbers.
    """
    series = [
        dictionary
        for dictionary in DICTIONARIES
        if dictionary.rpartition("_")[0] == name.rpartition("_")[0] and name.endswith("_1000")
    ] or [name]
    return next(
        dictionary
        for dictionary in series
        if dictionary == name or np.mean(numbers < DICTIONARIES[dictionary]) > MIN_VALID_FRACTION
    )


def most_frequent_family(pictures: Pictures) -> tuple[str, int, NDArray[np.int64]]:
    """Return the family with the most markers, its border in cells, and the (N,) numbers read.

    A picture takes a third of a second for each family. So once one family is clearly present,
    families that are not are no longer read.
    """
    numbers_by_family = {family: np.zeros(0, np.int64) for family in FAMILIES}
    for picture in pictures:
        numbers_by_family = {
            family: np.append(numbers, read_markers(picture, *family).numbers)
            for family, numbers in numbers_by_family.items()
        }
        highest_count = max(map(len, numbers_by_family.values()))
        if highest_count >= CLEAR_COUNT:
            numbers_by_family = {
                family: numbers
                for family, numbers in numbers_by_family.items()
                if len(numbers) > CHANCE_FRACTION * highest_count
            }
    name, cells = max(numbers_by_family, key=lambda family: len(numbers_by_family[family]))
    return name, cells, numbers_by_family[name, cells]


def _describe_other_layout(markers: Sequence[Markers], board: Board) -> str:
    """Return a sentence if the markers can be read, but lie as on a board with another layout."""
    if isinstance(board.coding, Charuco):
        legacy = board.coding.legacy_pattern
        if board.rows % 2 and _fits(
            markers,
            replace(board, coding=replace(board.coding, legacy_pattern=not legacy)),
            MIN_LINKED_FRACTION,
        ):
            kind, write = ("new", "false") if legacy else ("legacy", "true")
            return (
                f"the markers lie as on a board of the {kind} pattern: write board.legacy_pattern:"
                f" {write} in session.yaml."
            )
        for fraction in MARKER_FRACTIONS:
            if _fits(
                markers,
                replace(board, coding=replace(board.coding, marker=fraction * board.square)),
                MIN_LINKED_FRACTION,
            ):
                return (
                    f"the markers are about {fraction:.1f} of a square wide: correct"
                    " board.marker_mm in session.yaml."
                )
    corners = 2 if isinstance(board.coding, AprilGrid) else 1
    for columns in range(2, MAX_COLUMNS):
        if _fits(markers, replace(board, columns=corners * columns), MIN_LINKED_FRACTION):
            return (
                f"the markers lie as on a board with {columns} columns, not as on {board}: write"
                f" board.columns: {columns} in session.yaml."
            )
    return ""


def _fits(markers: Sequence[Markers], board: Board, min_linked: float = 0.0) -> bool:
    """True if in most pictures enough of the markers, and at least this part, lie as on this board,
    or on one with more rows.
    """
    count = 1 + max(int(picture.numbers.max(initial=0)) for picture in markers)
    taller = replace(board, rows=board.rows + 2 * count)
    matches = 0
    for picture in markers:
        board_markers = select_board_markers(picture, taller)
        if not isinstance(board_markers, NotFound):
            matches += len(board_markers.numbers) >= min_linked * len(picture.numbers)
    return 2 * matches >= len(markers)

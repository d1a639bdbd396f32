"""Identify the board with markers that the pictures show in place of the declared one, as far as
its markers allow.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.board_markers import select_board_markers
from calib.corners.detection import NotFound
from calib.corners.markers import Markers, border_of, marker_places, read_markers
from calib.session.board import Board
from calib.session.board_section import KALIBR, board_to_yaml
from calib.session.coding import (
    DICTIONARIES,
    FIRST_ROWS,
    ROTATIONS_DEG,
    AprilGrid,
    Charuco,
    Coding,
)

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
MAX_FIRST_MARKERS = 100
"""First numbers that are tried."""
MARKER_FRACTIONS = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4)
"""Marker sizes to try, in parts of a square: markers are linked if their size is declared to a
tenth.
"""

Pictures = Sequence[NDArray[np.uint8]]


@dataclass(frozen=True, slots=True)
class OtherNumbering:
    """A board whose markers lie as the declared one's, but have other numbers or another print."""

    board: Board
    changes: Mapping[str, object]
    """The values of the keys of session.yaml in which it differs."""
    finding: str
    """A clause that says how it differs."""

    @property
    def keys(self) -> str:
        """The keys with their values, as a message names them."""
        values = {key: str(value).lower() for key, value in self.changes.items()}
        return ", ".join(f"board.{key}: {value}" for key, value in values.items())


def other_coding(pictures: Pictures, board: Board) -> str:
    """Return a sentence that says what to correct, or "" if no other board is recognised."""
    coding = board.coding
    assert coding
    border = border_of(coding)
    shown = [negative(picture) for picture in pictures] if coding.inverted else pictures
    markers = [read_markers(picture, coding.dictionary, border) for picture in shown]
    if _fits(markers, board) and _has_own_numbers(markers, board):
        return ""
    if other := find_other_numbering(pictures, board):
        return f"{other.finding}: write {other.keys} in session.yaml."
    if advice := _describe_other_layout(markers, board):
        return advice
    mirrored_markers = [
        read_markers(np.ascontiguousarray(picture[:, ::-1]), coding.dictionary, border)
        for picture in shown
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


def find_other_numbering(pictures: Pictures, board: Board) -> OtherNumbering | None:
    """Return the board that the (H, W) pictures show if its markers lie as on the declared one, but
    with other numbers, with another border, turned, or white on black.
    """
    assert board.coding
    for inverted in (board.coding.inverted, not board.coding.inverted):
        for border in _borders(board.coding):
            shown = [negative(picture) for picture in pictures] if inverted else pictures
            markers = [read_markers(picture, board.coding.dictionary, border) for picture in shown]
            if sum(len(picture.numbers) for picture in markers) < MIN_MARKERS * len(pictures) / 2:
                continue
            for numbering in numberings(board.coding):
                coding = replace(board.coding, inverted=inverted, **numbering)
                if isinstance(coding, AprilGrid):
                    coding = replace(coding, border=border)
                for first in _possible_first_markers(markers, board):
                    other = replace(board, coding=replace(coding, first_marker=first))
                    if not (
                        _has_own_numbers(markers, other)
                        and _fits(markers, other, MIN_LINKED_FRACTION)
                    ):
                        continue
                    if other.coding == board.coding:
                        return None
                    return _compare(board, other, markers)
    return None


def _has_own_numbers(markers: Sequence[Markers], board: Board) -> bool:
    """True if the board has at least half of the numbers that were read: other numbers may lie as
    on a taller board.
    """
    assert board.coding
    first = board.coding.first_marker
    numbers = np.concatenate([picture.numbers for picture in markers])
    within = (numbers >= first) & (numbers < first + len(marker_places(board)))
    return not len(numbers) or bool(2 * within.sum() >= len(numbers))


def negative(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the (H, W) picture with light and dark exchanged."""
    return np.asarray(cv2.bitwise_not(picture), np.uint8)


def _borders(coding: Coding) -> tuple[int, ...]:
    """Return the borders in cells that a board of this type may have, the declared one first."""
    is_open = isinstance(coding, AprilGrid) and coding.crossings
    return (coding.border, 3 - coding.border) if is_open else (coding.border,)


def numberings(coding: Coding) -> list[dict[str, Any]]:
    """Return the ways in which a board of this type may be numbered, the declared one first."""
    if not (isinstance(coding, AprilGrid) and coding.crossings):
        return [{}]
    declared = {"numbered_from": coding.numbered_from, "rotation_deg": coding.rotation_deg}
    choices = [
        {"numbered_from": row, "rotation_deg": rotation}
        for row in FIRST_ROWS
        for rotation in ROTATIONS_DEG
    ]
    return sorted(choices, key=lambda choice: choice != declared)


def _possible_first_markers(markers: Sequence[Markers], board: Board) -> list[int]:
    """Return the first numbers with which the board would have most of the numbers that were read,
    the declared one first, then from the highest on: a board that is seen whole has that one.
    """
    assert board.coding
    numbers = np.sort(np.concatenate([picture.numbers for picture in markers]))
    skipped = int((1 - MIN_LINKED_FRACTION) / 2 * len(numbers))
    low = int(numbers[skipped])
    high = int(numbers[len(numbers) - 1 - skipped])
    declared = board.coding.first_marker
    earliest = max(0, high + 1 - len(marker_places(board)))
    lowest = int(numbers[0])
    candidates = [declared, lowest, *range(low, max(earliest, low - MAX_FIRST_MARKERS) - 1, -1)]
    return list(dict.fromkeys(candidates))


def _compare(board: Board, other: Board, markers: Sequence[Markers]) -> OtherNumbering:
    """Describe the keys in which another board differs from the declared one."""
    declared = board_to_yaml(board)
    keys = board_to_yaml(other)
    defaults = {
        "first_marker": 0,
        "inverted": False,
        "border_cells": 2,
        "numbered_from": "lower_left",
        "tag_rotation_deg": 180,
    }
    changes = {
        key: keys.get(key, default)
        for key, default in defaults.items()
        if keys.get(key, default) != declared.get(key, default)
    }
    assert other.coding
    first = other.coding.first_marker
    words = {
        "first_marker": (
            f"the markers have the numbers {first} to {_last_number(markers, other)}, where those"
            f" of the declared {board} board begin at {declared.get('first_marker', 0)}"
        ),
        "inverted": "the board is printed white on black"
        if changes.get("inverted")
        else "the board is printed black on white",
        "border_cells": "the tags have a black border of"
        f" {'one cell' if changes.get('border_cells') == 1 else 'two cells'}",
        "numbered_from": "the tags are numbered from the"
        f" {str(changes.get('numbered_from')).replace('_', ' ')}",
        "tag_rotation_deg": "the tags are turned otherwise than Kalibr's",
    }
    return OtherNumbering(other, changes, " and ".join(words[key] for key in changes))


def _last_number(markers: Sequence[Markers], board: Board) -> int:
    """Return the highest number of the board that was read."""
    assert board.coding
    end = board.coding.first_marker + len(marker_places(board))
    numbers = np.concatenate([picture.numbers for picture in markers])
    return int(numbers[numbers < end].max())


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
    highest = max(int(picture.numbers.max(initial=0)) for picture in markers)
    assert board.coding
    count = max(1, 1 + highest - board.coding.first_marker)
    taller = replace(board, rows=board.rows + 2 * count)
    matches = 0
    for picture in markers:
        board_markers = select_board_markers(picture, taller)
        if not isinstance(board_markers, NotFound):
            matches += len(board_markers.numbers) >= min_linked * len(picture.numbers)
    return 2 * matches >= len(markers)

"""Find out which board pictures show, without a declared one: its type, its size and its markers.

What a picture cannot tell is not guessed: the size of a square in mm.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.board_markers import select_board_markers
from calib.corners.board_size import shown_size
from calib.corners.detection import NotFound
from calib.corners.markers import Markers, marker_places, read_markers
from calib.corners.misprint import measure_marker_size, measure_spacing, refine_tag_outlines
from calib.corners.other_coding import (
    MARKER_FRACTIONS,
    MAX_COLUMNS,
    MIN_LINKED_FRACTION,
    MIN_MARKERS,
    most_frequent_family,
    negative,
    numberings,
    smallest_dictionary,
)
from calib.corners.picture_scale import reduce_picture, reducing_factor
from calib.corners.unusable_target import why_unusable
from calib.errors import OtherBoardError
from calib.session.board import Board
from calib.session.board_section import EXAMPLES, KALIBR, board_to_yaml
from calib.session.coding import DICTIONARIES, AprilGrid, Charuco, Coding, grid_board

MAX_SIDE = 1920
"""px, the longer side of the pictures that are searched: the search takes seconds, not minutes."""
MARKER_PICTURES = 4
"""Pictures that are searched for markers: a dictionary is either in all of them or in none."""
CLEAR_FRACTION = 0.95
"""Part of the markers that no other layout explains as well."""
SPACING_STEP = 0.05
"""Gaps of AprilGrids are whole multiples of this, in sides of a tag, as their makers offer them."""
SPACING_ERROR = 0.02
"""The largest error of a measured gap."""
BORDER_PLACE = 0.12
"""From a tag's corner to its middle: half of a border of one cell in eight."""
CROSSING_FRACTION = 0.5
"""Part of the contrast between a tag's border and the paper by which a square between tags is
darker than the paper.
"""

Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class FoundBoard:
    """A board that pictures show. Its squares or tags have a side of one metre, for want of a true
    one.
    """

    board: Board
    pictures: int
    """The number of pictures that show it."""
    searched: int
    """The number of pictures that were searched."""
    is_vague: bool = False
    """True for an AprilGrid with a gap that no maker offers: it must be measured."""

    @property
    def kind(self) -> str:
        """The type of the board in session.yaml."""
        return str(board_to_yaml(self.board).get("type", "checkerboard"))

    @property
    def side_key(self) -> str:
        """The key of session.yaml for the length that no picture tells."""
        return f"{self.board.cell}_mm"

    @property
    def size(self) -> tuple[int, int]:
        """The columns and rows that session.yaml has."""
        size = self.to_yaml(1.0)
        return int(str(size["columns"])), int(str(size["rows"]))

    @property
    def sentence(self) -> str:
        """The finding as a clause, without a full stop."""
        match self.board.coding:
            case Charuco(dictionary=dictionary):
                return f"Found a {self.board} board with markers of {dictionary}"
            case AprilGrid(dictionary=dictionary, crossings=False):
                return f"Found a {self.board} with markers of {dictionary}"
            case AprilGrid():
                return f"Found a {self.board}"
            case None:
                return f"Found a checkerboard of {self.board} inner corners"

    @property
    def options(self) -> str:
        """The options of a command line that describe the board, with an example of its size."""
        return self.options_for(self._example_mm)

    @property
    def _example_mm(self) -> float:
        return float(str(EXAMPLES[self.kind][self.side_key]))

    def options_for(self, side_mm: float | None) -> str:
        """Return the options of a command line that describe the board with squares or tags of this
        side, mm. None: the word MM stands for each length.
        """
        words = []
        for key, value in self.to_yaml(side_mm or self._example_mm).items():
            if key in ("columns", "rows") or value is False:
                continue
            option = f"--{key.replace('_', '-')}"
            if side_mm is None and key.endswith("_mm"):
                words += [option, "MM"]
                continue
            words += (
                [option]
                if value is True
                else [option, f"{value:g}" if isinstance(value, float) else str(value)]
            )
        columns, rows = self.size
        return " ".join([f"--board {columns}x{rows}", *words])

    def to_yaml(self, side_mm: float) -> dict[str, object]:
        """Return the section `board` of session.yaml for squares or tags of this side, mm."""
        coding = self.board.coding
        scale = side_mm / 1000
        if isinstance(coding, Charuco):
            coding = replace(coding, marker=round(coding.marker * scale, 6))
        return board_to_yaml(replace(self.board, square=scale, coding=coding))


def search_board(pictures: Sequence[Picture]) -> FoundBoard | None:
    """Return the board that most of the (H, W) pictures show; None if they show none, or several.

    A chessboard is searched for first, as it is found fastest. One picture of it then shows whether
    it has markers.

    Raises:
        OtherBoardError: what the pictures show cannot be measured, such as a grid of circles.
    """
    small = shrink(pictures)
    chessboard = shown_size(pictures)
    found = None
    if chessboard:
        shown = chessboard.pictures
        board = Board(chessboard.columns, chessboard.rows, 1.0)
        found = FoundBoard(board, len(shown), chessboard.searched)
    may_have_markers = not chessboard or _search_markers([small[chessboard.pictures[0]]])
    if may_have_markers and (coded := _search_markers(small[:MARKER_PICTURES])):
        return coded
    if reason := why_unusable(pictures, chessboard):
        raise OtherBoardError(f"{reason}.")
    return found


def shrink(pictures: Sequence[Picture]) -> list[Picture]:
    """Return the (H, W) pictures, those that are larger reduced to MAX_SIDE."""
    return [reduce_picture(picture, reducing_factor(picture, MAX_SIDE)) for picture in pictures]


def _search_markers(pictures: Sequence[Picture]) -> FoundBoard | None:
    """Return the board with markers that the (H, W) pictures show, be it white on black."""
    if found := _search_dark_markers(pictures):
        return found
    found = _search_dark_markers([negative(picture) for picture in pictures])
    if not (found and found.board.coding):
        return None
    coding = replace(found.board.coding, inverted=True)
    return replace(found, board=replace(found.board, coding=coding))


def _search_dark_markers(pictures: Sequence[Picture]) -> FoundBoard | None:
    name, border, numbers = most_frequent_family(pictures)
    if len(numbers) <= MIN_MARKERS * max(1.0, len(pictures) / 2):
        return None
    dictionary = smallest_dictionary(name, numbers)
    markers = [read_markers(picture, dictionary, border) for picture in pictures]
    if border == 1 and (found := _find_charuco(markers, dictionary)):
        return found
    if dictionary == KALIBR.dictionary:
        grid = replace(KALIBR, border=border)
        codings = [replace(grid, **numbering) for numbering in numberings(grid)]
        found = _find_grid(pictures, markers, codings)
        if border != 1 or not found or _has_crossings(pictures, markers, found.board):
            return found
    return _find_grid(pictures, markers, [grid_board(KALIBR.spacing, dictionary)])


def _find_grid(
    pictures: Sequence[Picture], markers: Sequence[Markers], codings: Sequence[AprilGrid]
) -> FoundBoard | None:
    candidates = [
        Board(2 * columns, 2, 1.0, coding=coding)
        for coding in codings
        for columns in range(2, MAX_COLUMNS)
    ]
    board = _best_layout(markers, candidates)
    if not board or not isinstance(board.coding, AprilGrid):
        return None
    gaps = []
    for _, corners in _outline_corners(pictures, markers, board):
        gap = measure_spacing(corners, board)
        gaps += [gap] if gap is not None else []
    if not gaps:
        return None
    gap = float(np.median(gaps))
    nearest = round(SPACING_STEP * round(gap / SPACING_STEP), 2)
    sure = abs(gap - nearest) <= SPACING_ERROR
    spacing = nearest if sure else round(gap, 2)
    coding = replace(board.coding, spacing=spacing, dictionary=_sufficient_dictionary(board))
    return FoundBoard(replace(board, coding=coding), len(gaps), len(pictures), not sure)


def _outline_corners(
    pictures: Sequence[Picture], markers: Sequence[Markers], board: Board
) -> Iterator[tuple[Picture, NDArray[np.float64]]]:
    """Yield each picture that shows the grid, with the (count, 2) px corners of its tags."""
    for picture, read in zip(pictures, markers, strict=True):
        selected = select_board_markers(read, board)
        if not isinstance(selected, NotFound):
            yield picture, refine_tag_outlines(selected, board, picture)


def _has_crossings(pictures: Sequence[Picture], markers: Sequence[Markers], board: Board) -> bool:
    """True if dark squares touch the corners of a grid's tags, as on an AprilGrid. A GridBoard has
    none.
    """
    fractions = []
    for picture, corners in _outline_corners(pictures, markers, board):
        grid = corners.reshape(board.rows, board.columns, 2)
        middles = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
        borders = grid[:-1:2, :-1:2] + BORDER_PLACE * (middles[::2, ::2] - grid[:-1:2, :-1:2])
        dark = _median_grey(picture, borders)
        light = _median_grey(picture, middles[::2, 1::2])  # beside each other, two tags leave white
        fractions.append((light - _median_grey(picture, middles[1::2, 1::2])) / (light - dark))
    return float(np.nanmedian(fractions)) > CROSSING_FRACTION


def _median_grey(picture: Picture, places: NDArray[np.float64]) -> float:
    """Return the median grey level at (..., 2) px; NaN if none of them is known."""
    known = places[np.isfinite(places).all(-1)].astype(np.float32)
    if not len(known):
        return np.nan
    return float(np.median(cv2.remap(picture, known[:, :1], known[:, 1:], cv2.INTER_LINEAR)))


def _find_charuco(markers: Sequence[Markers], dictionary: str) -> FoundBoard | None:
    candidates = [
        Board(columns, 3, 1.0, coding=Charuco(fraction, dictionary, first_is_white))
        for fraction in MARKER_FRACTIONS
        for columns in range(2, MAX_COLUMNS)
        for first_is_white in (False, True)
    ]
    board = _best_layout(markers, candidates)
    if not board or not isinstance(board.coding, Charuco):
        return None
    sizes = []
    for read in markers:
        selected = select_board_markers(read, board)
        if not isinstance(selected, NotFound):
            size = measure_marker_size(selected, board)
            sizes += [size] if size is not None else []
    if not sizes:
        return None
    marker = round(float(np.median(sizes)) * board.coding.marker, 2)
    coding = replace(board.coding, marker=marker, dictionary=_sufficient_dictionary(board))
    return FoundBoard(replace(board, coding=coding), len(sizes), len(markers))


def _sufficient_dictionary(board: Board) -> str:
    """Return the first dictionary that begins as the board's does and has all of its markers."""
    assert board.coding
    dictionary = board.coding.dictionary
    series, _, count = dictionary.rpartition("_")
    if not count.isdigit():  # such as DICT_APRILTAG_36h11, which begins as no other does
        return dictionary
    needed = board.coding.first_marker + len(marker_places(board))
    return next(
        name
        for name, count in (*DICTIONARIES.items(), (dictionary, needed))
        if name.rpartition("_")[0] == series and count >= needed
    )


def _best_layout(markers: Sequence[Markers], candidates: Sequence[Board]) -> Board | None:
    """Return the candidate on which most of the markers lie, with the first marker and as many rows
    as the markers need; None if they lie on none of them.

    A candidate's own rows say whether their number is odd, which the first square of a legacy
    ChArUco board depends on.
    """
    richest = max(markers, key=lambda read: len(read.numbers))
    everything = sum(len(read.numbers) for read in markers)
    best, highest = None, int(MIN_LINKED_FRACTION * everything)
    lowest = min(int(read.numbers.min()) for read in markers if len(read.numbers))
    firsts = dict.fromkeys((0, lowest, int(richest.numbers.min())))
    for candidate in (_from_marker(first, board) for first in firsts for board in candidates):
        if len(_on_board([richest], candidate)) <= MIN_LINKED_FRACTION * len(richest.numbers):
            continue
        # markers of another size may be linked in a picture of a board that faces the camera
        linked = len(_on_board(markers, candidate))
        if linked > highest:
            best, highest = candidate, linked
        if linked > CLEAR_FRACTION * everything:
            break
    if not best:
        return None
    numbers = _on_board(markers, best)
    assert best.coding
    is_grid = isinstance(best.coding, AprilGrid)
    # Charuco boards have the same places in every other row.
    period = best.columns // 2 if is_grid else best.columns + 1
    unseen = int(numbers.min()) // period * period
    if unseen > (1 + numbers.max()) / 2:
        best = _from_marker(best.coding.first_marker + unseen, best)
        numbers = numbers - unseen
    legacy = isinstance(best.coding, Charuco) and best.coding.legacy_pattern
    step = 2 if legacy or is_grid else 1
    rows = best.rows if legacy else 2
    while len(marker_places(replace(best, rows=rows))) <= numbers.max():
        rows += step
    return replace(best, rows=rows)


def _from_marker(first: int, board: Board) -> Board:
    """Return the board with this number of its first marker."""
    assert board.coding
    coding: Coding = replace(board.coding, first_marker=first)
    return replace(board, coding=coding)


def _on_board(markers: Sequence[Markers], board: Board) -> NDArray[np.int64]:
    """Return the (N,) numbers of the markers that lie as on this board, or on one with more rows,
    counted from its first marker.
    """
    count = 1 + max(int(read.numbers.max(initial=0)) for read in markers)
    taller = replace(board, rows=board.rows + 2 * (1 + 2 * count // board.columns))
    selected = [select_board_markers(read, taller) for read in markers]
    groups = [group.numbers for group in selected if not isinstance(group, NotFound)]
    return np.concatenate([*groups, np.zeros(0, np.int64)])

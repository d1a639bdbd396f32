"""Lay out the sheet: the board as large as possible, rulers along its left and its lower side, and
the words below.
"""

from dataclasses import dataclass

from calib.errors import InputError
from calib.sheet.paper import Paper
from calib.sheet.ruler import RULER_DEPTH, RULER_ENDS, RULER_LENGTHS, draw_ruler
from calib.sheet.sheet import Sheet
from calib.sheet.target import Pattern
from calib.sheet.words import set_lines, sheet_paragraphs

PAPER_EDGE = 5.0
"""mm that many printers leave blank."""
WIDE_MARGIN = 1.0
"""Sides of a square: the white margin around a board whose squares are as large as possible.
Detectors need it.
"""
NARROW_MARGIN = 0.2
"""Sides of a square: the smallest white margin around a board whose side is given. With it, calib's
detectors find a board on a black ground.
"""


@dataclass(frozen=True, slots=True)
class _Room:
    """A sheet that holds a board of one size with rulers and words."""

    paper: Paper
    side: float
    x_start: float
    """mm, where the y ruler ends and the board's margin starts."""
    y_end: float
    """mm, where the board's margin ends and the x ruler starts."""
    rulers: tuple[int, int]
    """mm, the lengths of the x and the y ruler."""
    words: tuple[str, ...]
    white: float
    """mm, the width of the narrowest free strip around the board."""


def lay_out(pattern: Pattern, papers: tuple[Paper, ...], side: float | None) -> Sheet:
    """Return the sheet with squares of this side (mm), or of the largest whole number of mm that
    leaves a wide margin. Raise InputError if there is no room.
    """
    if side is None:
        side = _largest_side(pattern, papers, WIDE_MARGIN)
    rooms = [
        room
        for paper in papers
        if side and (room := _find_room(pattern, paper, side, NARROW_MARGIN))
    ]
    if side is None or not rooms:
        raise InputError(_refusal(pattern, papers, side))
    return _draw_sheet(pattern, max(rooms, key=lambda room: room.white))


def _largest_side(pattern: Pattern, papers: tuple[Paper, ...], margin: float) -> float | None:
    """Return the largest whole number of mm; None where not even one has room."""
    longest = int(max(papers[0].width, papers[0].height) / min(pattern.extent))
    return next(
        (
            float(mm)
            for mm in range(longest, 0, -1)
            if any(_find_room(pattern, paper, mm, margin) for paper in papers)
        ),
        None,
    )


def _find_room(pattern: Pattern, paper: Paper, side: float, margin: float) -> _Room | None:
    """Return the room for the board; None where its white margin would be narrower than `margin`
    sides, or the board nearer to the paper's edge than PAPER_EDGE.
    """
    width = pattern.extent[0] * side
    height = pattern.extent[1] * side
    x_start = PAPER_EDGE + RULER_DEPTH
    white_x = (paper.width - x_start - width) / 2
    if white_x < max(PAPER_EDGE, margin * side):
        return None
    length_x = next(
        (
            length
            for length in RULER_LENGTHS
            if length <= paper.width - x_start - PAPER_EDGE - 2 * RULER_ENDS
        ),
        0,
    )
    for length_y in RULER_LENGTHS if length_x else ():
        words = sheet_paragraphs(pattern, paper, side, (length_x, length_y))
        y_end = (
            paper.height
            - PAPER_EDGE
            - set_lines(words, (0, 0), paper.width - 2 * PAPER_EDGE)[1]
            - RULER_DEPTH
        )
        if length_y <= y_end - PAPER_EDGE - 2 * RULER_ENDS:
            white = min(white_x, (y_end - height) / 2)
            return (
                _Room(paper, side, x_start, y_end, (length_x, length_y), words, white)
                if white >= max(PAPER_EDGE, margin * side)
                else None
            )
    return None


def _draw_sheet(pattern: Pattern, room: _Room) -> Sheet:
    paper = room.paper
    target = pattern.draw(room.side)
    width = pattern.extent[0] * room.side
    height = pattern.extent[1] * room.side
    x = (room.x_start + paper.width - width) / 2
    y = (room.y_end - height) / 2
    a, b = room.rulers
    a_start = _clamp(
        x + (width - a) / 2, room.x_start + RULER_ENDS, paper.width - PAPER_EDGE - RULER_ENDS - a
    )
    a_lines, a_texts = draw_ruler("a", (a_start, room.y_end), a)
    b_start = _clamp(y + (height + b) / 2, PAPER_EDGE + RULER_ENDS + b, room.y_end - RULER_ENDS)
    b_lines, b_texts = draw_ruler("b", (room.x_start, b_start), b, upwards=True)
    words, _ = set_lines(
        room.words, (PAPER_EDGE, room.y_end + RULER_DEPTH), paper.width - 2 * PAPER_EDGE
    )
    return Sheet(
        title=room.words[0],
        paper=paper,
        side=room.side,
        white=room.white,
        rulers=room.rulers,
        polygons=tuple(
            tuple((px + x, py + y) for px, py in polygon) for polygon in target.polygons
        ),
        corners=tuple((px + x, py + y) for px, py in target.corners),
        lines=a_lines + b_lines,
        texts=a_texts + b_texts + words,
    )


def _clamp(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def _refusal(pattern: Pattern, papers: tuple[Paper, ...], side: float | None) -> str:
    """Return why the board has no room, and which size has."""
    board = f"{pattern} with {pattern.cell}s of {side:g} mm" if side else f"{pattern}"
    paper = papers[0].name
    largest = _largest_side(pattern, papers, NARROW_MARGIN)
    largest_wide = _largest_side(pattern, papers, WIDE_MARGIN)
    if largest is None:
        return (
            f"{board} have no room on {paper} beside rulers and words: take a larger --paper, or"
            " fewer corners."
        )
    wide_hint = (
        f", or up to {largest_wide:g} mm to have a white margin as wide as one"
        if largest_wide not in (None, largest)
        else ""
    )
    return (
        f"{board} have no room on {paper} beside rulers and words: take {pattern.cell}s of up to"
        f" {largest:g} mm{wide_hint}."
    )

"""The board, as large as there is room for, a ruler along its left and its lower side, and the
words below.
"""

from dataclasses import dataclass

from calib.errors import InputError
from calib.sheet.paper import Paper
from calib.sheet.ruler import DEPTH, ENDS, LENGTHS, ruler
from calib.sheet.sheet import Sheet
from calib.sheet.target import Pattern
from calib.sheet.words import sentences, set_lines

EDGE = 5.0
"""mm, which many printers leave free."""
WIDE = 1.0
"""Of the side: the white margin around a board whose squares are to be as large as they can be.

Detectors ask for it.
"""
NARROW = 0.2
"""Of the side: the least white margin for squares of a given side.

Those of calib find a board on black with it.
"""


@dataclass(frozen=True, slots=True)
class _Room:
    """A sheet on which a board of one size leaves room for rulers and words."""

    paper: Paper
    side: float
    left: float
    """mm, where the y ruler ends and the board's margin begins."""
    bottom: float
    """mm, where the x ruler begins and the board's margin ends."""
    rulers: tuple[int, int]
    words: tuple[str, ...]
    white: float
    """mm, the least free strip around the board."""


def lay_out(pattern: Pattern, papers: tuple[Paper, ...], side: float | None) -> Sheet:
    """The sheet with squares of this side (mm), or of the most whole ones that leave a wide margin;
    InputError if there is no room.
    """
    if side is None:
        side = _largest(pattern, papers, WIDE)
    rooms = [room for paper in papers if side and (room := _room(pattern, paper, side, NARROW))]
    if side is None or not rooms:
        raise InputError(_refusal(pattern, papers, side))
    return _sheet(pattern, max(rooms, key=lambda room: room.white))


def _largest(pattern: Pattern, papers: tuple[Paper, ...], margin: float) -> float | None:
    """mm, the most whole ones; None where not even one has room."""
    longest = int(max(papers[0].width, papers[0].height) / min(pattern.extent))
    return next(
        (
            float(mm)
            for mm in range(longest, 0, -1)
            if any(_room(pattern, paper, mm, margin) for paper in papers)
        ),
        None,
    )


def _room(pattern: Pattern, paper: Paper, side: float, margin: float) -> _Room | None:
    """None where the white would be narrower than `margin` sides, or the board nearer to the
    paper's edge than EDGE.
    """
    width, height = (sides * side for sides in pattern.extent)
    left = EDGE + DEPTH
    white_across = (paper.width - left - width) / 2
    if white_across < max(EDGE, margin * side):
        return None
    a = next((length for length in LENGTHS if length <= paper.width - left - EDGE - 2 * ENDS), 0)
    for b in LENGTHS if a else ():
        words = sentences(pattern, paper, side, (a, b))
        bottom = paper.height - EDGE - set_lines(words, (0, 0), paper.width - 2 * EDGE)[1] - DEPTH
        if b <= bottom - EDGE - 2 * ENDS:
            white = min(white_across, (bottom - height) / 2)
            return (
                _Room(paper, side, left, bottom, (a, b), words, white)
                if white >= max(EDGE, margin * side)
                else None
            )
    return None


def _sheet(pattern: Pattern, room: _Room) -> Sheet:
    paper, drawn = room.paper, pattern.draw(room.side)
    width, height = (sides * room.side for sides in pattern.extent)
    x, y = (room.left + paper.width - width) / 2, (room.bottom - height) / 2
    a, b = room.rulers
    a_lines, a_texts = ruler(
        "a",
        (
            _within(x + (width - a) / 2, room.left + ENDS, paper.width - EDGE - ENDS - a),
            room.bottom,
        ),
        a,
    )
    zero = _within(y + (height + b) / 2, EDGE + ENDS + b, room.bottom - ENDS)
    b_lines, b_texts = ruler("b", (room.left, zero), b, upwards=True)
    words, _ = set_lines(room.words, (EDGE, room.bottom + DEPTH), paper.width - 2 * EDGE)
    return Sheet(
        room.words[0],
        paper,
        room.side,
        room.white,
        room.rulers,
        tuple(tuple((px + x, py + y) for px, py in polygon) for polygon in drawn.polygons),
        tuple((px + x, py + y) for px, py in drawn.corners),
        a_lines + b_lines,
        a_texts + b_texts + words,
    )


def _within(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def _refusal(pattern: Pattern, papers: tuple[Paper, ...], side: float | None) -> str:
    asked = f"{pattern} with {pattern.part}s of {side:g} mm" if side else f"{pattern}"
    most, wide = _largest(pattern, papers, NARROW), _largest(pattern, papers, WIDE)
    if most is None:
        return (
            f"{asked} have no room on {papers[0].name} beside rulers and words: take a larger"
            " --paper, or fewer corners."
        )
    and_wide = (
        f", of up to {wide:g} mm with a white margin as wide as they are"
        if wide not in (None, most)
        else ""
    )
    return (
        f"{asked} have no room on {papers[0].name} beside rulers and words: {pattern.part}s of up"
        f" to {most:g} mm do{and_wide}."
    )

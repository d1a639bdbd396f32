"""Draw a ruler of a known length, with a tick each millimetre, to be measured after printing."""

from calib.sheet.sheet import DIGIT, LineSegment, Text
from calib.sheet.target import Point

RULER_LENGTHS: tuple[int, ...] = (*range(1000, 0, -50), 40, 30, 20, 10)
"""mm, round lengths, longest first. On a longer ruler, a reading's error is a smaller share."""
LINE_WIDTH = 0.12  # mm, of a tick
TICKS = ((10, 2.6), (5, 1.8), (1, 1.1))  # spacing and length, mm
SIZE = 2.0  # mm, of the numbers
GAP = 0.5
RULER_DEPTH = TICKS[0][1] + GAP + SIZE
"""mm, the width of a ruler with its numbers."""
RULER_ENDS = 7.0
"""mm, the room that its name and its last number take beyond either end."""


def draw_ruler(
    name: str, zero: Point, length: float, *, upwards: bool = False
) -> tuple[tuple[LineSegment, ...], tuple[Text, ...]]:
    """Draw a ruler rightwards from zero with the ticks below, or upwards with the ticks on the
    left.
    """

    def place(axial: float, transverse: float) -> Point:
        return (
            (zero[0] - transverse, zero[1] - axial)
            if upwards
            else (zero[0] + axial, zero[1] + transverse)
        )

    marks = [LineSegment(place(-LINE_WIDTH / 2, 0), place(length + LINE_WIDTH / 2, 0), LINE_WIDTH)]
    for mm in range(round(length) + 1):
        tick_length = next(tick_length for spacing, tick_length in TICKS if mm % spacing == 0)
        marks.append(LineSegment(place(mm, 0), place(mm, tick_length), LINE_WIDTH))
    bottom = TICKS[0][1] + GAP + 0.72 * SIZE
    baseline = TICKS[0][1] + GAP if upwards else bottom
    texts = [Text(place(-RULER_ENDS, baseline), 1.3 * SIZE, name, bold=True, upwards=upwards)]
    for mm in range(0, round(length) + 1, TICKS[0][0]):
        words = f"{mm}" + (" mm" if mm == length else "")
        texts.append(
            Text(
                place(mm - DIGIT * SIZE * len(f"{mm}") / 2, baseline), SIZE, words, upwards=upwards
            )
        )
    return tuple(marks), tuple(texts)

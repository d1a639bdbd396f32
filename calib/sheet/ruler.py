"""A ruler of a known length, with a tick each millimetre, to be measured after printing."""

from calib.sheet.sheet import DIGIT, Line, Text
from calib.sheet.target import Point

LENGTHS: tuple[int, ...] = (*range(1000, 0, -50), 40, 30, 20, 10)
"""mm, the round ones, longest first. The longer, the smaller the share of a reading's error."""
INK = 0.12  # mm, a tick's width
TICKS = ((10, 2.6), (5, 1.8), (1, 1.1))  # mm apart, and mm long
SIZE = 2.0  # mm, of the numbers
GAP = 0.5
DEPTH = TICKS[0][1] + GAP + SIZE
"""mm, how much room a ruler takes across."""
ENDS = 7.0
"""mm, what its name and its last number take beyond either end."""


def ruler(
    name: str, zero: Point, length: float, *, upwards: bool = False
) -> tuple[tuple[Line, ...], tuple[Text, ...]]:
    """Rightwards from zero with the ticks below, or upwards with the ticks on the left."""

    def at(along: float, across: float) -> Point:
        return (
            (zero[0] - across, zero[1] - along) if upwards else (zero[0] + along, zero[1] + across)
        )

    marks = [Line(at(-INK / 2, 0), at(length + INK / 2, 0), INK)]
    for mm in range(round(length) + 1):
        deep = next(deep for apart, deep in TICKS if mm % apart == 0)
        marks.append(Line(at(mm, 0), at(mm, deep), INK))
    bottom = TICKS[0][1] + GAP + 0.72 * SIZE
    baseline = TICKS[0][1] + GAP if upwards else bottom
    texts = [Text(at(-ENDS, baseline), 1.3 * SIZE, name, bold=True, upwards=upwards)]
    for mm in range(0, round(length) + 1, TICKS[0][0]):
        words = f"{mm}" + (" mm" if mm == length else "")
        texts.append(
            Text(at(mm - DIGIT * SIZE * len(f"{mm}") / 2, baseline), SIZE, words, upwards=upwards)
        )
    return tuple(marks), tuple(texts)

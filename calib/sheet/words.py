"""What the sheet says of itself: its parameters, what to measure after printing, and where to enter
that.
"""

from textwrap import wrap

from calib.sheet.paper import Paper
from calib.sheet.sheet import Text
from calib.sheet.target import Pattern, Point

TITLE = 2.9, 0.58
"""The size of its letters (mm), and how wide one may be on average, in sizes: in lines that are
full, Helvetica's bold has 0.48 to 0.57.
"""
BODY = 2.4, 0.48
"""The same: 0.41 to 0.46."""
LEADING = 1.25
"""Of the font's size, from line to line."""
STRETCH = 0.002
"""How far the two rulers may differ before paper is called stretched: what two readings of half a
millimetre make of 25 cm.
"""


def sentences(
    pattern: Pattern, paper: Paper, side: float, rulers: tuple[int, int]
) -> tuple[str, ...]:
    """The title, then one paragraph each. `rulers` are a and b, mm."""
    a, b = rulers
    shorter = min(rulers)
    size = f"{paper.width:g} × {paper.height:g} mm"
    named = size if paper.name == size else f"{paper.name}, {size}"
    board = pattern.to_yaml(side, "{value: VALUE, sigma: SIGMA}")
    entry = ", ".join(
        f"{key}: {str(value).lower() if isinstance(value, bool) else value}"
        for key, value in board.items()
    )
    return (
        (
            f"{pattern.title}, {pattern.part}s of {side:g} mm. Paper: {named}. Print at 100 %, no"
            " scaling."
        ),
        (
            "1. Glue the sheet onto something flat and stiff. Then measure the rulers a and b"
            " between their end ticks, in mm, with a steel ruler or a calliper."
        ),
        (
            f"2. The side of a {pattern.part} is VALUE = {side:g} * (a / {a} + b / {b}) / 2 with"
            f" SIGMA = {side:g} * D / 2 / {shorter}, where D is your ruler's smallest division (for"
            f" 1 mm {side / 2 / shorter:.2g}). In session.yaml, write board: {{{entry}}}"
        ),
        (
            f"3. If a / {a} and b / {b} differ by more than {100 * STRETCH:g} %, the printer"
            " stretched the sheet: calib diagnose estimates by how much (board_scale)."
        ),
    )


def set_lines(
    paragraphs: tuple[str, ...], corner: Point, width: float
) -> tuple[tuple[Text, ...], float]:
    """The lines of a block of this width (mm) below its upper left corner, and its height (mm)."""
    texts: list[Text] = []
    x, y = corner
    for number, paragraph in enumerate(paragraphs):
        size, letter = BODY if number else TITLE
        for words in wrap(paragraph, int(width / (letter * size))):
            y += LEADING * size
            texts.append(Text((x, y), size, words, bold=number == 0))
    return tuple(texts), y - corner[1]

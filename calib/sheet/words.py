"""Write the words on the sheet: its parameters, what to measure after printing, and where to enter
it.
"""

from textwrap import wrap

from calib.sheet.paper import Paper
from calib.sheet.sheet import Text
from calib.sheet.target import Pattern, Point

TITLE_FONT = 2.9, 0.58
"""The letters' size (mm), and the largest mean width of a letter in sizes. In full lines,
Helvetica's bold has 0.48 to 0.57.
"""
BODY_FONT = 2.4, 0.48
"""The same for the body: 0.41 to 0.46 in full lines."""
LEADING = 1.25
"""The distance of lines in font sizes."""
STRETCH = 0.002
"""The relative difference of the two rulers above which paper is called stretched: two readings
with an error of half a millimetre differ by as much over 25 cm.
"""


def sheet_paragraphs(
    pattern: Pattern, paper: Paper, side: float, rulers: tuple[int, int]
) -> tuple[str, ...]:
    """Return the title, then the other paragraphs. `rulers` are a and b, mm."""
    a, b = rulers
    shorter = min(rulers)
    size = f"{paper.width:g} × {paper.height:g} mm"
    paper_text = size if paper.name == size else f"{paper.name}, {size}"
    board = pattern.to_yaml(side, "{value: VALUE, sigma: SIGMA}")
    entry = ", ".join(
        f"{key}: {str(value).lower() if isinstance(value, bool) else value}"
        for key, value in board.items()
    )
    return (
        (
            f"{pattern.title}, {pattern.cell}s of {side:g} mm. Paper: {paper_text}. Print at 100 %,"
            " no scaling."
        ),
        (
            "1. Glue the sheet onto something flat and stiff. Then measure the rulers a and b"
            " between their end ticks, in mm, with a steel ruler or a calliper."
        ),
        (
            f"2. The side of a {pattern.cell} is VALUE = {side:g} * (a / {a} + b / {b}) / 2 with"
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
    """Return the lines of a block of this width (mm) below its upper left corner, and its height
    (mm).
    """
    texts: list[Text] = []
    x, y = corner
    for number, paragraph in enumerate(paragraphs):
        size, letter = BODY_FONT if number else TITLE_FONT
        for words in wrap(paragraph, int(width / (letter * size))):
            y += LEADING * size
            texts.append(Text((x, y), size, words, bold=number == 0))
    return tuple(texts), y - corner[1]

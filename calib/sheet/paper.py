"""The paper sizes that people print on."""

from dataclasses import dataclass

MIN_PAPER_SIDE = 50.0
"""mm"""
MAX_PAPER_SIDE = 5000.0
"""mm: a PDF page is at most 5080 mm long."""


@dataclass(frozen=True, slots=True)
class Paper:
    """A paper size, landscape or portrait."""

    name: str
    width: float
    """mm"""
    height: float
    """mm"""

    @property
    def rotated(self) -> "Paper":
        """The same paper, rotated by 90 degrees."""
        return Paper(self.name, self.height, self.width)


PAPERS = (Paper("A4", 297.0, 210.0), Paper("A3", 420.0, 297.0), Paper("Letter", 279.4, 215.9))
"""The paper sizes with a name. They may be rotated."""


def parse_paper(text: str) -> tuple[Paper, ...] | None:
    """Return the papers that a name, or width x height in mm, allows; None where it is neither.

    A named paper may be rotated; a size is taken as it is written.
    """
    for paper in PAPERS:
        if paper.name.lower() == text.lower():
            return paper, paper.rotated
    width, _, height = text.lower().partition("x")
    try:
        size = float(width), float(height)
    except ValueError:
        return None
    if not all(MIN_PAPER_SIDE <= length <= MAX_PAPER_SIDE for length in size):
        return None
    return (Paper(f"{size[0]:g} × {size[1]:g} mm", *size),)

"""The sheets that people print on."""

from dataclasses import dataclass

SMALLEST = 50.0
"""mm"""
LARGEST = 5000.0
"""mm: PDF has no page above 5080."""


@dataclass(frozen=True, slots=True)
class Paper:
    name: str
    width: float
    """mm"""
    height: float
    """mm"""

    @property
    def turned(self) -> "Paper":
        return Paper(self.name, self.height, self.width)


PAPERS = (Paper("A4", 297.0, 210.0), Paper("A3", 420.0, 297.0), Paper("Letter", 279.4, 215.9))
"""Those with a name. Either way up will do."""


def papers(text: str) -> tuple[Paper, ...] | None:
    """What a name, or width x height in mm, allows; None where it is neither.

    A size is taken as it is written.
    """
    for paper in PAPERS:
        if paper.name.lower() == text.lower():
            return paper, paper.turned
    width, _, height = text.lower().partition("x")
    try:
        size = float(width), float(height)
    except ValueError:
        return None
    if not all(SMALLEST <= length <= LARGEST for length in size):
        return None
    return (Paper(f"{size[0]:g} × {size[1]:g} mm", *size),)

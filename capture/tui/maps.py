"""Coverage as small maps: of shades, which need no colour, in a terminal; as numbers for a page
that draws them.
"""

import numpy as np
from numpy.typing import NDArray

from capture.tui.page import Line

SHADES = " ░▒▓█"


def shade_cells(covered: NDArray[np.float64], columns: int, rows: int) -> str:
    """Return (h, w) coverage, 0 to 1, in rows of columns characters; a full block is fully
    covered.
    """
    height, width = covered.shape
    y = ((np.arange(rows) + 0.5) * height / rows).astype(int)
    x = ((np.arange(columns) + 0.5) * width / columns).astype(int)
    level = np.clip(np.nan_to_num(covered[np.ix_(y, x)]) * (len(SHADES) - 1), 0, len(SHADES) - 1)
    # a partly covered cell never looks empty, and only a fully covered one looks full
    index = np.where((level > 0) & (level < 1), 1, np.floor(level)).astype(int)
    return "\n".join("".join(SHADES[entry] for entry in line) for line in index)


class CoverageMap(Line):
    title = ""
    covered: NDArray[np.float64] | None = None
    """(h, w) coverage, 0 to 1; None: there is only a text."""
    full = ""
    """The meaning of a fully covered place."""

    def show_map(self, title: str, covered: NDArray[np.float64], text: str, full: str) -> None:
        """
        Args:
            title: the title on a page that draws the map.
            covered: (h, w) coverage, 0 to 1.
            text: the map as a terminal shows it.
            full: the meaning of a fully covered place.
        """
        self.title, self.covered, self.full = title, np.clip(np.nan_to_num(covered), 0, 1), full
        self.say(text)

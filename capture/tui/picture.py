"""The camera's picture as a widget."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import groupby
from typing import Any

import numpy as np
from rich.segment import Segment
from rich.style import Style
from textual.geometry import Size
from textual.reactive import reactive
from textual.strip import Strip
from textual.widget import Widget

from capture.tui.camera import Preview
from capture.tui.cells import (
    CORNER_MARK,
    HINT_MARK,
    LINE_MARK,
    WORST_MARK,
    Cells,
    Mark,
    draw,
    fit_cells,
)

INK = {
    CORNER_MARK: "bold rgb(80,255,80)",
    HINT_MARK: "bold rgb(255,210,0)",
    WORST_MARK: "bold rgb(255,110,80)",
    LINE_MARK: "bold rgb(100,230,250)",
}
"""The colours of the marks: they help, but the characters suffice."""
LETTERS = "bold rgb(0,0,0) on rgb(255,210,0)"


class Picture(Widget):
    """A widget that shows the newest frame, as large as its shape allows, in the middle of its
    place.
    """

    DEFAULT_CSS = "Picture { background: $background; }"
    dots: reactive[bool] = reactive(False)
    phone: reactive[bool] = reactive(False)
    """True if a phone draws the picture, which needs it in more detail."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.updates = 0
        """The number of changes of the picture."""
        self.preview: Preview | None = None
        self.marks: Sequence[Mark] = ()
        self._cells: Cells | None = None
        self._cells_for: Size | None = None

    def show(self, preview: Preview | None, marks: Sequence[Mark]) -> None:
        self.updates += 1
        self.preview, self.marks, self._cells = preview, marks, None
        if not self.phone:  # a phone draws it itself
            self.refresh()

    def on_mount(self) -> None:
        self.watch(self.app, "dots", self._change_dots)
        self.watch(self.app, "on_phone", self._change_phone)

    def _change_dots(self, dots: bool) -> None:
        self.dots = dots

    def _change_phone(self, phone: bool) -> None:
        self.phone = phone

    def watch_dots(self) -> None:
        self._cells = None

    def render_line(self, y: int) -> Strip:
        width, height = self.size
        blank = Strip.blank(width, self.rich_style)
        if self.preview is None or not width:
            return blank
        columns, rows = fit_cells(self.preview.size, width, height)
        if self._cells is None or self._cells_for != self.size:
            self._cells = draw(
                self.preview.grey, self.preview.size, columns, rows, self.marks, dots=self.dots
            )
            self._cells_for = self.size
        row = y - (height - rows) // 2
        if not 0 <= row < rows:
            return blank
        margin = (width - columns) // 2
        segments = [Segment(" " * margin, self.rich_style), *_segments(self._cells, row, self.dots)]
        return Strip([*segments, Segment(" " * (width - columns - margin), self.rich_style)], width)


def _segments(cells: Cells, row: int, dots: bool) -> list[Segment]:
    line = zip(
        cells.characters[row].tolist(),
        cells.upper[row].tolist(),
        cells.lower[row].tolist(),
        strict=True,
    )
    if dots:
        return [Segment("".join(character for character, _, _ in line), Style())]
    return [
        Segment((character or "▀") * len(list(same)), _style(character, upper, lower))
        for (character, upper, lower), same in groupby(line)
    ]


@lru_cache(4096)
def _style(character: str, upper: int, lower: int) -> Style:
    if not character:
        return Style.parse(f"rgb({upper},{upper},{upper}) on rgb({lower},{lower},{lower})")
    if character not in INK:
        return Style.parse(LETTERS)
    # darkened, so that a mark is visible on a white square too
    middle = int(np.mean([upper, lower])) // 2
    return Style.parse(f"{INK[character]} on rgb({middle},{middle},{middle})")

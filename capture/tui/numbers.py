"""The panels with the numbers of a calibration: one of its camera, and one of its cover, which is
drawn from the side.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from textual.app import ComposeResult
from textual.containers import Horizontal, VerticalScroll
from textual.widgets import Static

from calib.errors import harmless
from capture.tui.child import Event
from capture.tui.section_drawing import draw_section

DRAWING_SIZE = (20, 9)  # columns and rows
CELL_WIDTH = 24  # columns
COVER_CAPTION = f"{'':<17}{'calibrated':<17}declared"


class Numbers(VerticalScroll):
    """Camera and cover beside each other, or below each other in a narrow terminal."""

    DEFAULT_CSS = """
    Numbers { height: auto; max-height: 50%; padding: 0 1; layout: horizontal; }
    Numbers Static { height: auto; }
    Numbers #camera { width: 47; }
    Numbers #behind { width: 1fr; height: auto; }
    Numbers #cover { width: 1fr; }
    Numbers #section { width: 22; padding: 0 0 0 2; }
    Numbers.-narrow { height: 1fr; max-height: 100%; layout: vertical; }
    Numbers.-narrow #camera { width: 1fr; }
    """

    def __init__(self, result: Event) -> None:
        """`result` is that of the fit (`capture.tui.fitting.results_summary`)."""
        super().__init__(can_focus=False)
        self._sections = {section["name"]: section for section in result["numbers"]}
        self._surfaces = [np.array(surface) for surface in result["cover_section"]]

    def compose(self) -> ComposeResult:
        yield Static(id="camera", markup=False)
        with Horizontal(id="behind"):
            yield Static(_text(self._cover_lines()), id="cover", markup=False)
            if drawing := draw_section(self._surfaces, *DRAWING_SIZE):
                yield Static(f"From the side\n{drawing}", id="section", markup=False)

    def lay_out(self, *, narrow: bool) -> None:
        """Put the panels below each other if the terminal is narrow, or else beside each other."""
        self.set_class(narrow, "-narrow")
        self.query_one("#camera", Static).update(_text(self._camera_lines(narrow=narrow)))

    def _camera_lines(self, *, narrow: bool) -> Iterator[str]:
        camera = self._sections["camera"]
        size, lens = str(camera["title"]).split(", ", 1)
        yield from [f"{size}, {lens}"] if narrow else [size, lens]
        cells = [f"{_short(name)} {value}" for name, value, *_ in camera["rows"]]
        fx, fy, cx, cy, *coefficients = cells
        yield from _in_columns((fx, cx, fy, cy), 2)
        yield from _in_columns(coefficients, 3 if narrow else 2)
        rows = self._rows("pictures")
        places = [f"{name}: {value}" for name, value, *_ in rows]
        yield from ["   ".join(places)] if narrow else places

    def _cover_lines(self) -> Iterator[str]:
        for section in map(self._sections.get, ("cover", "effects")):
            if section:
                yield str(section["title"])
                yield from [COVER_CAPTION] if section["name"] == "cover" else []
                yield from map(_line, section["rows"])

    def _rows(self, name: str) -> Sequence[Sequence[str]]:
        section: Mapping[str, Any] = self._sections.get(name, {"rows": []})
        rows: Sequence[Sequence[str]] = section["rows"]
        return rows


def _text(lines: Iterable[str]) -> str:
    return "\n".join(map(harmless, lines))


def _short(name: str) -> str:
    """Return a number's name without the part that the panel's title says."""
    return name.removeprefix("camera.").removeprefix("cover.")


def _in_columns(cells: Sequence[str], columns: int) -> Iterator[str]:
    for start in range(0, len(cells), columns):
        row = cells[start : start + columns]
        yield "".join(f"{cell:<{CELL_WIDTH}}" for cell in row).rstrip()


def _line(row: Sequence[str]) -> str:
    """Return the line of a number. A declared value that the views contradict has a mark."""
    name, value, declared, note, *_ = row
    words = note if note == "not fitted" else declared
    mark = " ✗" if "contradicted" in note else ""
    return f"{_short(name):<17}{value:<17}{words}{mark}".rstrip()

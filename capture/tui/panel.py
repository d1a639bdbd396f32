"""The panel beside the picture: the number of views, their coverage, and whether they are
enough.
"""

from collections.abc import Sequence

from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.reactive import reactive

from capture.coverage import SessionProgress
from capture.tui.cells import CORNER_MARK, HINT_MARK
from capture.tui.maps import CoverageMap, shade_cells
from capture.tui.page import Line

MAP_SIZE = (13, 5)  # columns and rows of a coverage map
MARKS_LEGEND = f"{CORNER_MARK} found   {HINT_MARK} hold it here"
COUNT_LEGEND = "░ ▒ ▓ some views   █ enough"
ACCURACY_LEGEND = "░▒▓ less sure   █ sure enough"
"""The legends of the shades of picture and depth: the number of views, and once it is computed, the
maps' accuracy.
"""
GLASS_TITLE, GLASS_UNKNOWN = (
    "Glass crossed",
    "Glass\nThe patch of cover looked through: not computed yet.",
)
"""The plain rule takes each pixel for a point of the glass, whose map would repeat the
picture's.
"""


class Panel(Vertical):
    DEFAULT_CSS = """
    Panel { padding: 0 1; }
    Panel #count { text-style: bold; height: 1; }
    Panel #enough { height: auto; min-height: 4; max-height: 6; }
    Panel #maps { height: 6; }
    Panel #maps Line { width: 13; margin: 0 2 0 0; }
    Panel #depth { height: 1; }
    Panel #legend { height: 2; color: $text-muted; }
    Panel #notes { height: 1fr; color: $text-muted; }
    """
    progress: reactive[SessionProgress | None] = reactive(None)

    def __init__(self, *, covered: bool) -> None:
        """`covered` is True if the camera looks through a cover, so that its glass has its
        own map.
        """
        super().__init__()
        self._covered = covered

    def compose(self) -> ComposeResult:
        yield Line(id="count", markup=False)
        yield Line(id="enough", markup=False)
        with Horizontal(id="maps"):
            yield CoverageMap(id="image", markup=False)
            yield CoverageMap(id="glass", markup=False)
        yield CoverageMap(id="depth", markup=False)
        yield Line(f"{MARKS_LEGEND}\n{COUNT_LEGEND}", id="legend", markup=False)
        yield Line(id="notes", markup=False)

    def count(self, views: int, *, automatic: bool) -> None:
        self.query_one("#count", Line).say(
            f"{views} view{'s' * (views != 1)}   auto {'ON' if automatic else 'OFF'}"
        )

    def say(self, remarks: Sequence[str]) -> None:
        """Show the remarks about the camera; the newest first."""
        self.query_one("#notes", Line).say("\n".join(reversed(remarks)))

    def watch_progress(self, progress: SessionProgress | None) -> None:
        if progress is None:
            return
        self.query_one("#enough", Line).say(progress.sentence)
        self.query_one("#legend", Line).say(
            f"{MARKS_LEGEND}\n{COUNT_LEGEND if progress.sigma_px is None else ACCURACY_LEGEND}"
        )
        full = "enough" if progress.sigma_px is None else "sure"
        image = self.query_one("#image", CoverageMap)
        glass = self.query_one("#glass", CoverageMap)
        depth = self.query_one("#depth", CoverageMap)
        image.show_map(
            "Picture", progress.image, f"Picture\n{shade_cells(progress.image, *MAP_SIZE)}", full
        )
        if self._covered and progress.sigma_px is None:
            glass.say(GLASS_UNKNOWN)
        elif self._covered:
            glass.show_map(
                "Glass",
                progress.glass,
                f"{GLASS_TITLE}\n{shade_cells(progress.glass, *MAP_SIZE)}",
                "enough",
            )
        row = progress.depth[None]
        depth.show_map(
            "Depth, near to far", row, f"Depth  near {shade_cells(row, 13, 1)} far", full
        )

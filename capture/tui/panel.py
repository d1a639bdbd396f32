"""Beside the picture: how many views there are, what they cover, and whether they are enough."""

from collections.abc import Sequence

from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.reactive import reactive

from capture.coverage import SessionProgress
from capture.tui.cells import FOUND, HINT
from capture.tui.maps import CoverageMap, shaded
from capture.tui.page import Line

MAP = (13, 5)  # columns and rows of a coverage map
MARKS = f"{FOUND} found   {HINT} hold it here"
COUNTED, COMPUTED = "░ ▒ ▓ some views   █ enough", "░▒▓ less sure   █ sure enough"
"""What the shades of picture and depth say: how many views there are, and once it is computed, how
sure the maps are.
"""
GLASS, NO_GLASS = "Glass crossed", "Glass\nThe patch of cover looked through: not computed yet."
"""A plain rule takes each pixel for a point of the glass, whose map would be the picture's once
more.
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
        """`covered`: the camera looks through a cover, so its glass has a map of its own."""
        super().__init__()
        self._covered = covered

    def compose(self) -> ComposeResult:
        yield Line(id="count", markup=False)
        yield Line(id="enough", markup=False)
        with Horizontal(id="maps"):
            yield CoverageMap(id="image", markup=False)
            yield CoverageMap(id="glass", markup=False)
        yield CoverageMap(id="depth", markup=False)
        yield Line(f"{MARKS}\n{COUNTED}", id="legend", markup=False)
        yield Line(id="notes", markup=False)

    def count(self, views: int, *, automatic: bool) -> None:
        self.query_one("#count", Line).say(
            f"{views} view{'s' * (views != 1)}   auto {'ON' if automatic else 'OFF'}"
        )

    def say(self, remarks: Sequence[str]) -> None:
        """What a person should know of the camera; the newest first."""
        self.query_one("#notes", Line).say("\n".join(reversed(remarks)))

    def watch_progress(self, progress: SessionProgress | None) -> None:
        if progress is None:
            return
        self.query_one("#enough", Line).say(progress.sentence)
        self.query_one("#legend", Line).say(
            f"{MARKS}\n{COUNTED if progress.sigma_px is None else COMPUTED}"
        )
        full = "enough" if progress.sigma_px is None else "sure"
        image, glass, depth = (
            self.query_one(f"#{name}", CoverageMap) for name in ("image", "glass", "depth")
        )
        image.cover("Picture", progress.image, f"Picture\n{shaded(progress.image, *MAP)}", full)
        if self._covered and progress.sigma_px is None:
            glass.say(NO_GLASS)
        elif self._covered:
            glass.cover(
                "Glass", progress.glass, f"{GLASS}\n{shaded(progress.glass, *MAP)}", "enough"
            )
        row = progress.depth[None]
        depth.cover("Depth, near to far", row, f"Depth  near {shaded(row, 13, 1)} far", full)

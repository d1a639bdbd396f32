"""The notice that replaces a screen, a page or a dialog, in a terminal that is too small for it."""

from typing import Any, ClassVar, TypeVar

from textual import on
from textual.events import Resize
from textual.geometry import Size
from textual.screen import ModalScreen, Screen
from textual.widget import Widget
from textual.widgets import Static

MIN_SIZE = (80, 24)
"""The columns and rows for which every screen is drawn."""
TOO_SMALL = "-small"
"""The class of a screen in a terminal that is too small."""
Answer = TypeVar("Answer")


class SizeNotice(Static):
    """The text in place of the other widgets. Every screen yields one."""

    DEFAULT_CSS = """
    SizeNotice { display: none; width: 1fr; height: 1fr; }
    SizeNotice { content-align: center middle; text-align: center; }
    Screen.-small > * { display: none; }
    Screen.-small > SizeNotice { display: block; }
    """
    SCOPED_CSS: ClassVar = False  # these rules concern the widgets beside this one

    def __init__(self) -> None:
        super().__init__(id="small", markup=False)
        self._previous_focus: Widget | None = None
        """The widget with the focus before the terminal became too small: hidden widgets lose
        it.
        """

    def follow_size(self, size: Size) -> None:
        """Replace the screen's other widgets, or show them again."""
        was_too_small = is_too_small(self.screen)
        now_too_small = size.width < MIN_SIZE[0] or size.height < MIN_SIZE[1]
        if now_too_small and not was_too_small:
            self._previous_focus = self.screen.focused
        elif (
            was_too_small
            and not now_too_small
            and self._previous_focus
            and self._previous_focus.is_attached
        ):
            self.screen.call_after_refresh(self._previous_focus.focus)
        self.screen.set_class(now_too_small, TOO_SMALL)
        self.update(
            f"This terminal has {size.width} columns and {size.height} rows.\n"
            f"Enlarge it to {MIN_SIZE[0]} and {MIN_SIZE[1]}, or make its letters smaller: what runs"
            " goes on.\nUntil then no key does anything but q, which quits."
        )


def is_too_small(screen: Screen[Any]) -> bool:
    """Return True if the notice replaces the screen's widgets."""
    return screen.has_class(TOO_SMALL)


class Dialog(ModalScreen[Answer]):
    """A screen over a page."""

    @on(Resize)
    def _follow_size(self, event: Resize) -> None:
        self.query_one(SizeNotice).follow_size(event.size)

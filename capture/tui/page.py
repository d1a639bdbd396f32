"""The parts of every screen: a line with the steps of the way, a line of keys, and a sentence where
the terminal is too small.
"""

import asyncio
from abc import abstractmethod
from typing import Any, ClassVar

from textual import on
from textual.actions import SkipAction
from textual.app import ComposeResult
from textual.binding import Binding
from textual.events import Key, Resize
from textual.message import Message
from textual.screen import Screen
from textual.widget import Widget
from textual.widgets import Footer, Input, Static

from capture.tui.child import Child, Event
from capture.tui.help import HelpScreen

STEPS = ("Set-up", "Without cover", "Through cover", "Fit", "Results")
MIN_SIZE = (80, 24)
"""The columns and rows for which every screen is drawn."""

HELP_AND_QUIT = (
    Binding("question_mark", "help", "Help", key_display="?"),
    Binding("q", "app.quit", "Quit"),
)
"""The keys of screens without fields."""

TYPING = (
    Binding("enter", "onward", show=False, priority=True),
    Binding("tab", "app.focus_next", "Next field", key_display="tab", priority=True),
    Binding("shift+tab", "app.focus_previous", show=False, priority=True),
)
"""The keys of screens with fields. The screen handles these keys before the fields do, so that text
typed after them, however fast, as over a slow connection, goes to the next field.
"""


DOTS = Binding("m", "app.dots", "Dots")
"""The key of screens with a picture."""


class Line(Static):
    """A text that is laid out only when it changes: a text that is set twenty times a second mostly
    stays the same.
    """

    def say(self, text: str) -> None:
        if text != str(self.content):
            self.update(text)


class Field(Input):
    """A field whose editing keys work in their turn. Those of Input take a detour through the app,
    where letters typed later overtake them.
    """

    EDITING: ClassVar = {
        key: binding.action
        for binding in Input.BINDINGS
        if isinstance(binding, Binding)
        for key in binding.key.split(",")
    }

    async def on_key(self, event: Key) -> None:
        if action := self.EDITING.get(event.key):
            event.stop()
            event.prevent_default()
            await self.run_action(action)


class ChildReported(Message):
    """An event of a process that a page follows; each kind of page has its own subclass."""

    def __init__(self, child: Child, event: Event) -> None:
        super().__init__()
        self.child = child
        self.event = event


class Page(Screen[bool]):
    """A step on the way from nothing to a calibration."""

    DEFAULT_CSS = """
    Page > #steps { height: 1; background: $panel; text-style: bold; }
    Page > #small { display: none; width: 1fr; height: 1fr; }
    Page > #small { content-align: center middle; text-align: center; }
    Page.-small > * { display: none; }
    Page.-small > #small { display: block; }
    """

    PART: ClassVar[str] = ""
    """The part of the step that this page shows, if it is not the step's only page."""

    _previous_focus: Widget | None = None
    """The widget with the focus before the terminal became too small: hidden widgets lose it."""

    def compose(self) -> ComposeResult:
        yield Static(self._step_line(), id="steps", markup=False)
        yield from self.body()
        yield Static(id="small", markup=False)
        yield Footer(show_command_palette=False, compact=True)

    @abstractmethod
    def body(self) -> ComposeResult:
        """The widgets between the first line and the last."""

    @abstractmethod
    def step(self) -> str:
        """Return the name of this step, one of STEPS."""

    def _step_line(self) -> str:
        current = f"[{self.step().upper()}{self.PART and f': {self.PART}'}]"
        return " " + " › ".join(current if step == self.step() else step for step in STEPS)

    def action_help(self) -> None:
        self.app.push_screen(HelpScreen())

    @property
    def is_too_small(self) -> bool:
        """True if the terminal is too small, so that a notice replaces all widgets."""
        return self.has_class("-small")

    @on(Resize)
    def _measure(self, event: Resize) -> None:
        is_too_small = event.size.width < MIN_SIZE[0] or event.size.height < MIN_SIZE[1]
        if is_too_small and not self.is_too_small:
            self._previous_focus = self.focused
        elif (
            self.is_too_small
            and not is_too_small
            and self._previous_focus
            and self._previous_focus.is_attached
        ):
            self.call_after_refresh(self._previous_focus.focus)
        self.set_class(is_too_small, "-small")
        if is_too_small:
            words = f"This terminal has {event.size.width} columns and {event.size.height} rows.\n"
            words += (
                f"Enlarge it to {MIN_SIZE[0]} and {MIN_SIZE[1]}, or make its letters smaller: what"
                " runs goes on.\n"
            )
            words += "Until then no key does anything but q, which quits."
            self.query_one("#small", Static).update(words)


def focus_next_field(screen: Screen[Any]) -> None:
    """Move from a field to the next one; elsewhere, leave enter its usual meaning."""
    if not isinstance(screen.focused, Input):
        raise SkipAction
    screen.focus_next()


async def wait_for_typing(screen: Screen[Any]) -> None:
    """Wait until every earlier key is in its field, and the screen has got the resulting messages.

    A key that the screen handles first overtakes those.
    """
    for widget in reversed(list(screen.query("*"))):  # inner widgets before outer ones
        done = asyncio.Event()
        widget.call_later(done.set)
        while widget.is_attached and not done.is_set():
            await asyncio.sleep(0.001)

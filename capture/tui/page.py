"""What every screen has: a line that says where one is on the way, a line of keys, and a sentence
where the terminal is too small.
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
SMALLEST = (80, 24)
"""Columns and rows that every screen is drawn for."""

HELP_AND_QUIT = (
    Binding("question_mark", "help", "Help", key_display="?"),
    Binding("q", "app.quit", "Quit"),
)
"""For screens on which nothing is typed."""

TYPING = (
    Binding("enter", "onward", show=False, priority=True),
    Binding("tab", "app.focus_next", "Next field", key_display="tab", priority=True),
    Binding("shift+tab", "app.focus_previous", show=False, priority=True),
)
"""For screens on which something is typed. These keys are looked at before the fields see them, so
that what is typed after them, however fast, as over a slow connection, goes to the next field.
"""


DOTS = Binding("m", "app.dots", "Dots")
"""For screens with a picture."""


class Line(Static):
    """A text that is laid out only when it changes: what is said twenty times a second mostly stays
    the same.
    """

    def say(self, text: str) -> None:
        if text != str(self.content):
            self.update(text)


class Field(Input):
    """A field whose editing keys work in their turn: Input's go round by the app, where letters
    that were typed later overtake them.
    """

    EDITING: ClassVar = {
        key: each.action
        for each in Input.BINDINGS
        if isinstance(each, Binding)
        for key in each.key.split(",")
    }

    async def on_key(self, event: Key) -> None:
        if action := self.EDITING.get(event.key):
            event.stop()
            event.prevent_default()
            await self.run_action(action)


class Said(Message):
    """What a process says that a page follows; each kind of page has a subclass of its own."""

    def __init__(self, child: Child, event: Event) -> None:
        super().__init__()
        self.child = child
        self.event = event


class Page(Screen[bool]):
    """A step on the way from nothing to a calibration."""

    DEFAULT_CSS = """
    Page > #steps { height: 1; background: $panel; text-style: bold; }
    Page > #small { display: none; width: 1fr; height: 1fr; content-align: center middle; text-align: center; }
    Page.-small > * { display: none; }
    Page.-small > #small { display: block; }
    """  # noqa: E501

    PART: ClassVar[str] = ""
    """Of the step, where this is not the whole of it."""

    _had_focus: Widget | None = None
    """What had the focus before the terminal became too small: what is hidden loses it."""

    def compose(self) -> ComposeResult:
        yield Static(self._way(), id="steps", markup=False)
        yield from self.body()
        yield Static(id="small", markup=False)
        yield Footer(show_command_palette=False, compact=True)

    @abstractmethod
    def body(self) -> ComposeResult:
        """The widgets between the first line and the last."""

    @abstractmethod
    def step(self) -> str:
        """Which of STEPS this is."""

    def _way(self) -> str:
        here = f"[{self.step().upper()}{self.PART and f': {self.PART}'}]"
        return " " + " › ".join(here if step == self.step() else step for step in STEPS)

    def action_help(self) -> None:
        self.app.push_screen(HelpScreen())

    @property
    def small(self) -> bool:
        """Whether the terminal is, so that a notice stands in the place of everything."""
        return self.has_class("-small")

    @on(Resize)
    def _measure(self, event: Resize) -> None:
        small = event.size.width < SMALLEST[0] or event.size.height < SMALLEST[1]
        if small and not self.small:
            self._had_focus = self.focused
        elif self.small and not small and self._had_focus and self._had_focus.is_attached:
            self.call_after_refresh(self._had_focus.focus)
        self.set_class(small, "-small")
        if small:
            words = f"This terminal has {event.size.width} columns and {event.size.height} rows.\n"
            words += (
                f"Enlarge it to {SMALLEST[0]} and {SMALLEST[1]}, or make its letters smaller: what"
                " runs goes on.\n"
            )
            words += "Until then no key does anything but q, which quits."
            self.query_one("#small", Static).update(words)


def onward(screen: Screen[Any]) -> None:
    """Enter in a field goes on to the next one; elsewhere it does what it does."""
    if not isinstance(screen.focused, Input):
        raise SkipAction
    screen.focus_next()


async def typed(screen: Screen[Any]) -> None:
    """Wait until every key that was pressed before is in its field, and on its way up what the
    screen is to hear of it.

    A key that a screen looks at first overtakes those.
    """
    for widget in reversed(list(screen.query("*"))):  # what is inside before what is around it
        done = asyncio.Event()
        widget.call_later(done.set)
        while widget.is_attached and not done.is_set():
            await asyncio.sleep(0.001)

"""The parts of every screen: a line with the steps of the way, a line of keys, and a sentence where
the terminal is too small.
"""

import asyncio
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from textual import on
from textual.actions import SkipAction
from textual.app import ComposeResult
from textual.binding import Binding
from textual.events import Key, Resize
from textual.message import Message
from textual.screen import Screen
from textual.widgets import Footer, Input, Static

from capture.tui.child import Child, Event
from capture.tui.help import HelpScreen
from capture.tui.sized import SizeNotice

STEPS = ("Set-up", "Without cover", "Through cover", "Fit", "Results")

HELP_AND_QUIT = (
    Binding("question_mark", "help", "Help", key_display="?"),
    Binding("q", "app.quit", "Quit"),
)
"""The keys of screens without fields."""

SET_UP = Binding("s", "correct", "Set-up")
"""The key of every page after the set-up: back to its values."""

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


class ToneRequested(Message):
    """An event with a tone: taken, refused or enough."""

    def __init__(self, tone: str) -> None:
        super().__init__()
        self.tone = tone


class CorrectionRequested(Message):
    """The person wants to correct a field of the set-up."""

    def __init__(self, page: Screen[Any], field: str, sentence: str) -> None:
        """
        Args:
            field: the name of the field; empty for the first value of the board.
            sentence: what to correct, and how to go on; empty if nothing is known to be wrong.
        """
        super().__init__()
        self.page = page
        self.field = field
        self.sentence = sentence


class Page(Screen[bool]):
    """A step on the way from nothing to a calibration."""

    DEFAULT_CSS = """
    Page > #steps { height: 1; background: $panel; text-style: bold; }
    """

    PART: ClassVar[str] = ""
    """The part of the step that this page shows, if it is not the step's only page."""

    def compose(self) -> ComposeResult:
        yield Line(self._step_line(), id="steps", markup=False)
        yield from self.body()
        yield SizeNotice()
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

    @property
    def early_actions(self) -> frozenset[str]:
        """The actions that are possible and not advised yet."""
        return frozenset()

    @property
    def finished_actions(self) -> frozenset[str]:
        """The actions that are possible and not needed: another one is the main one."""
        return frozenset(() if self.correction[0] else ("correct",))

    @property
    def correction(self) -> tuple[str, str]:
        """The field of the set-up that the key to it leads to, and the sentence there."""
        return "", ""

    @property
    def switches(self) -> Mapping[str, bool]:
        """The actions that turn something on and off, each with whether it is on."""
        return {}

    def action_correct(self) -> None:
        self.post_message(CorrectionRequested(self, *self.correction))

    def action_help(self) -> None:
        self.app.push_screen(HelpScreen())

    @on(Resize)
    def _follow_size(self, event: Resize) -> None:
        self.query_one(SizeNotice).follow_size(event.size)


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
        if not widget.call_later(done.set):
            continue  # it is on its way out
        while widget.is_attached and not done.is_set():
            await asyncio.sleep(0.001)

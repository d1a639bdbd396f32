"""Fit: what is being done, and how the error falls. The work is another process's, so the screen answers meanwhile."""

import re
from pathlib import Path
from typing import ClassVar

from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.message import Message
from textual.widgets import Static

from capture.tui.child import Child, Event
from capture.tui.page import HELP_AND_QUIT, Page

BAR = 24  # columns


class FitScreen(Page):
    DEFAULT_CSS = """
    FitScreen VerticalScroll { height: 1fr; padding: 1 1; }
    FitScreen #tasks { height: auto; }
    FitScreen #errors { height: auto; margin: 1 0 0 0; }
    FitScreen #sentence { height: 3; }
    """
    BINDINGS: ClassVar = [
        Binding("f", "again", "Fit again"),
        Binding("escape", "back", "Cancel, back", key_display="esc"),
        *HELP_AND_QUIT,
    ]

    class Said(Message):
        """The process that fits says something."""

        def __init__(self, child: Child, event: Event) -> None:
            super().__init__()
            self.child = child
            self.event = event

    def __init__(self, session: Path, before: Event | None = None) -> None:
        """`before`: the result of the fit before this one, to compare with."""
        super().__init__()
        self.session = session
        self.child: Child | None = None
        self._before = before
        self._tasks: list[tuple[str, int, int, str]] = []  # title, done, total, words
        self._errors: list[float] = []  # px

    def step(self) -> str:
        return "Fit"

    def body(self) -> ComposeResult:
        with VerticalScroll(can_focus=False):
            yield Static(id="tasks", markup=False)
            yield Static(id="errors", markup=False)
        yield Static(id="sentence", classes="banner", markup=False)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        del parameters
        return self.child is None if action == "again" else True

    def on_mount(self) -> None:
        self.action_again()

    def action_again(self) -> None:
        self._tasks, self._errors = [], []
        self.child = Child("capture.tui.fitting", [str(self.session), str(self.session / "calibration")])
        self.refresh_bindings()
        self._say("The views are fitted. The camera rests; esc cancels.")
        self._follow(self.child)

    @work(thread=True, group="fit")
    def _follow(self, child: Child) -> None:
        for event in child.events():
            self.post_message(self.Said(child, event))

    @on(Said)
    def _hear(self, message: Said) -> None:
        if message.child is not self.child:
            return
        match message.event:
            case {"event": "task", "title": title, "total": total}:
                if self._tasks:  # the one before has ended
                    name, _, length, words = self._tasks[-1]
                    self._tasks[-1] = name, length, length, words
                self._tasks.append((title, 0, total, ""))
            case {"event": "step", "done": done, "words": words}:
                title, _, total, said = self._tasks[-1]
                self._tasks[-1] = title, done, total, words or said
                if number := re.fullmatch(r"([\d.]+) px", words):
                    self._errors.append(float(number[1]))
            case {"event": "error", "sentence": sentence}:
                self.child = None
                self.refresh_bindings()
                self._say(f"{sentence} Press f to fit again, esc to go back.")
            case {"event": "result"} as result:
                from capture.tui.results import ResultsScreen

                self.app.switch_screen(ResultsScreen(self.session, result, self._before))
        self._draw()

    def _draw(self) -> None:
        lines = [f"{title:<20}{_bar(done / max(total, 1), BAR)} {done:>3}/{total:<4} {words}" for title, done, total, words in self._tasks]
        self.query_one("#tasks", Static).update("\n".join(lines))
        if self._errors:
            highest = max(self._errors)
            falling = [f"{'':20}{_bar(error / highest, BAR)} {error:.3f} px" for error in self._errors[-8:]]
            self.query_one("#errors", Static).update("\n".join(["The error that is left (root mean square):", *falling]))

    def _say(self, sentence: str) -> None:
        self.query_one("#sentence", Static).update(sentence)

    def action_back(self) -> None:
        self._cancel()
        self.app.pop_screen()

    def _cancel(self) -> None:
        if self.child:
            self.child.kill()
            self.child = None

    def on_unmount(self) -> None:
        self._cancel()


def _bar(share: float, width: int) -> str:
    full = min(round(share * width), width)
    return "█" * full + "░" * (width - full)

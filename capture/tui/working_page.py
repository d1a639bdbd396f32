"""The page of a process that calculates: its task, its progress, and how the error falls.

The screen stays responsive meanwhile.
"""

import re
from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

from textual import on, work
from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.events import ScreenResume
from textual.widgets import Static

from capture.tui.child import LOADING, Child, Event, Work
from capture.tui.page import ChildReported, Page

BAR_COLUMNS = 24  # columns
BEGINNING = (LOADING, 0, 1, "")
"""The first task, which is on the screen before the process has reported anything."""
REPEATED_ADVICE = "It failed in the same way again: press esc to go back, and mend that first."
ERRORS_HEADING = "Error left (rms, weighted: surer corners count more than in the results):"


class Bar(NamedTuple):
    title: str
    share: float
    """0 to 1"""
    words: str


class WorkingPage(Page):
    """A page that follows one process at a time.

    A subclass starts it by `follow`, and uses its result.
    """

    DEFAULT_CSS = """
    WorkingPage VerticalScroll { height: 1fr; padding: 1 1; }
    WorkingPage #tasks { height: auto; }
    WorkingPage #errors { height: auto; margin: 1 0 0 0; }
    WorkingPage #sentence { height: 3; }
    """
    RETRY_ADVICE: ClassVar[str]
    """The advice after a failure: which key to press."""

    class ProcessReported(ChildReported):
        """The process has sent an event."""

    def __init__(self) -> None:
        super().__init__()
        self.child: Child | None = None
        """The running process."""
        self._tasks: list[tuple[str, int, int, str]] = []  # title, done, total, words
        self._errors: list[tuple[str, float]] = []  # the task, and the error in px
        self.bars: Sequence[Bar] = ()
        """The bars on the screen, the running step first: a small page does not have them all."""
        self._failure = ""
        """The error that was shown last."""
        self._result: Event | None = None
        """The result that came while the help covered this screen."""

    @abstractmethod
    def finished(self, result: Event) -> None:
        """Use the result of a process that has succeeded."""

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

    @abstractmethod
    def action_again(self) -> None:
        """Start, or start again."""

    def follow(self, work: Work, *arguments: object) -> None:
        self._tasks, self._errors = [BEGINNING], []
        self._draw()
        self.child = Child(work, *arguments)
        self.refresh_bindings()
        self._listen(self.child)

    @work(thread=True, group="child")
    def _listen(self, child: Child) -> None:
        for event in child.events():
            self.post_message(self.ProcessReported(child, event))

    @on(ProcessReported)
    def _hear(self, message: ProcessReported) -> None:
        if message.child is not self.child:
            return
        match message.event:
            case {"event": "task", "title": title} if title == LOADING and self._tasks:
                pass  # its bar is there from the beginning
            case {"event": "task", "title": title, "total": total}:
                if self._tasks:  # the task before has ended
                    name, _, length, words = self._tasks[-1]
                    self._tasks[-1] = name, length, length, words
                self._tasks.append((title, 0, total, ""))
            case {"event": "step", "done": done, "words": words}:
                title, _, total, last_words = self._tasks[-1]
                self._tasks[-1] = title, done, total, words or last_words
                if number := re.fullmatch(r"([\d.]+) px", words):
                    self._errors.append((title, float(number[1])))
            case {"event": "error", "sentence": sentence}:
                self._clear_child()
                if self._tasks == [BEGINNING]:
                    self._tasks = []  # refused before there was anything to load
                repeated = sentence == self._failure
                advice = REPEATED_ADVICE if repeated else self.RETRY_ADVICE
                self._failure = sentence
                self.show_failure(sentence, advice)
            case {"event": "result"} as result:
                self._clear_child()
                if self.app.screen is self:
                    self.finished(result)
                    return
                self._result = result  # the app changes the front screen, which is not this one
        self._draw()

    @on(ScreenResume)
    def _finish(self) -> None:
        if self._result:
            result, self._result = self._result, None
            self.finished(result)

    def _clear_child(self) -> None:
        self.child = None
        self.refresh_bindings()

    def _draw(self) -> None:
        tasks = [
            Bar(title, done / max(total, 1), f"{done:>3}/{total:<4} {words}")
            for title, done, total, words in self._tasks
        ]
        maximum = max((error for _, error in self._errors), default=1.0)
        falling = [
            Bar(title, error / maximum, f"{error:.3f} px") for title, error in self._errors[-8:]
        ]
        width = max([20, *(len(bar.title) + 1 for bar in tasks)])
        newest = {bar.title: bar for bar in falling}  # a small page has one row for each step
        error_bars = [bar._replace(title=f"Error left, {title}") for title, bar in newest.items()]
        if len(tasks) > 1:
            tasks = [bar for bar in tasks if bar.title != LOADING]
        self.show(
            _draw_bars(tasks, width),
            "\n".join([ERRORS_HEADING, _draw_bars(falling, width)] if falling else []),
            bars=[*reversed(tasks), *reversed(error_bars)],
        )

    def show(self, above: str, below: str = "", bars: Sequence[Bar] = ()) -> None:
        """Show two texts; `bars` are the bars that they draw."""
        self.bars = bars
        self.query_one("#tasks", Static).update(above)
        self.query_one("#errors", Static).update(below)

    def show_failure(self, sentence: str, advice: str) -> None:
        """Show why the process failed, and what to do."""
        self.say(f"{sentence} {advice}")

    def say(self, sentence: str) -> None:
        self.query_one("#sentence", Static).update(sentence)

    def cancel(self) -> None:
        if self.child:
            self.child.kill()
            self.child = None

    def on_unmount(self) -> None:
        self.cancel()


def _draw_bars(bars: Sequence[Bar], width: int) -> str:
    """Return one line per bar, with its title in this many columns."""
    return "\n".join(
        f"{title:<{width}}{_bar(share, BAR_COLUMNS)} {words}" for title, share, words in bars
    )


def _bar(share: float, width: int) -> str:
    full = min(round(share * width), width)
    return "█" * full + "░" * (width - full)

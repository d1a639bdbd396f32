"""One question over a page: a field with a proposed answer, a button, and the reason why an answer
is invalid.
"""

from abc import abstractmethod
from typing import ClassVar

from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.suggester import Suggester
from textual.widgets import Button, Footer, Input, Label, Static

from calib.errors import InputError, harmless
from capture.tui.page import TYPING, Field, focus_next_field, wait_for_typing
from capture.tui.sized import Answer, Dialog, SizeNotice


def question_bindings(label: str) -> list[Binding]:
    """Return the bindings of a question; `label` is that of the one that answers it."""
    return [
        *TYPING,
        Binding("ctrl+s", "start", label, key_display="^s", priority=True),
        Binding("escape", "back", "Back", key_display="esc"),
    ]


class Question(Dialog[Answer | None]):
    """A question that is dismissed with an answer, or with None."""

    DEFAULT_CSS = """
    Question { align: center middle; }
    Question #box { width: 76; height: 14; padding: 0 1; }
    Question #box { border: round $primary; background: $surface; }
    Question .row { height: 1; margin: 1 0; }
    Question .row Label { width: 18; }
    Question .row Input { width: 1fr; height: 1; }
    Question #said { height: 1fr; }
    """
    ABOUT: ClassVar[str]
    NAME: ClassVar[str]
    """The id of the field, and the label before it."""
    LABEL: ClassVar[str]
    START: ClassVar[str]
    """The label of the button."""
    SUGGESTER: ClassVar[Suggester | None] = None

    def __init__(self, proposed: str) -> None:
        super().__init__()
        self._proposed = proposed

    def compose(self) -> ComposeResult:
        with Vertical(id="box"):
            yield Static(self.ABOUT, markup=False)
            field = Field(self._proposed, id=self.NAME, suggester=self.SUGGESTER, compact=True)
            yield Horizontal(Label(self.LABEL), field, classes="row")
            yield Button(self.START, variant="primary", compact=True)
            yield Static(id="said", markup=False)
        yield SizeNotice()
        yield Footer(show_command_palette=False, compact=True)

    @abstractmethod
    async def answer(self, text: str) -> Answer:
        """Return the answer for the typed text; InputError where the text is none."""

    @on(Button.Pressed)
    @work(exclusive=True, group="question")
    async def action_start(self) -> None:
        await wait_for_typing(self)
        try:
            self.dismiss(await self.answer(self.query_one(f"#{self.NAME}", Input).value.strip()))
        except InputError as error:
            self.query_one("#said", Static).update(harmless(f"✗ {error}"))
            self.query_one(f"#{self.NAME}", Input).focus()

    @on(Input.Changed)
    def _clear(self) -> None:
        """Take the reason away: it is of another answer."""
        self.query_one("#said", Static).update("")

    def action_onward(self) -> None:
        focus_next_field(self)

    def action_back(self) -> None:
        self.dismiss(None)

"""A line of a form: a label and its field. A cross on the label marks a wrong value, and a word
behind the field marks a value that the program assumes.
"""

from typing import Any

from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.widgets import Input, Label, Select, Static

CROSS = "✗ "
NEEDED = "needed"
"""The text of an empty field that must not stay empty."""
ASSUMED = "assumed"
"""The word behind a value that the program has put in, until a person changes it."""


class Row(Horizontal):
    DEFAULT_CSS = """
    Row { height: 1; width: 1fr; }
    Row Label { width: 19; }
    Row Input { width: 1fr; }
    Row Select { width: 1fr; height: 1; }
    Row .assumed { width: auto; color: $text-muted; }
    """

    def __init__(
        self,
        label: str,
        field: Input | Select[Any],
        assumption: str = "",
        note: str = ASSUMED,
    ) -> None:
        """
        Args:
            label: the words before the field.
            field: the field.
            assumption: the value that the program has put into the field, if it has.
            note: the words behind the field while it has this value.
        """
        super().__init__()
        self.note = note
        self.field = field
        self._label = label
        self._assumption = assumption

    def compose(self) -> ComposeResult:
        yield Label(self._label, id=f"label-{self.field.name or self.field.id}")
        yield self.field
        yield Static(self.note, classes=ASSUMED, markup=False)

    def on_mount(self) -> None:
        self._show_assumption()

    @property
    def is_assumed(self) -> bool:
        """True if the field has the value that the program assumed."""
        return bool(self._assumption) and str(self.field.value).strip() == self._assumption

    def assume(self, assumption: str) -> None:
        """Mark the field as assumed while it has this value; an empty text marks none."""
        self._assumption = assumption
        self._show_assumption()

    def mark(self, *, wrong: bool) -> None:
        label = self.query_one(Label)
        self.field.set_class(wrong, "wrong")
        words = str(label.content).removeprefix(CROSS)
        label.update(f"{CROSS}{words}" if wrong else words)

    @on(Input.Changed)
    @on(Select.Changed)
    def _show_assumption(self) -> None:
        for note in self.query(f".{ASSUMED}"):
            note.display = self.is_assumed

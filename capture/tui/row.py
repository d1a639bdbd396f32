"""A line of a form: a label and its field. A cross on the label marks a wrong value."""

from typing import Any

from textual.containers import Horizontal
from textual.widgets import Input, Label, Select

CROSS = "✗ "


class Row(Horizontal):
    DEFAULT_CSS = """
    Row { height: 1; width: 1fr; }
    Row Label { width: 19; }
    Row Input { width: 1fr; }
    Row Select { width: 1fr; height: 1; }
    """

    def __init__(self, label: str, field: Input | Select[Any]) -> None:
        super().__init__(Label(label, id=f"label-{field.name or field.id}"), field)
        self.field = field

    def mark(self, *, wrong: bool) -> None:
        label = self.query_one(Label)
        self.field.set_class(wrong, "wrong")
        words = str(label.content).removeprefix(CROSS)
        label.update(f"{CROSS}{words}" if wrong else words)

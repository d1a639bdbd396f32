"""At which depth the live picture is straightened."""

import argparse
from typing import ClassVar

from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.screen import ModalScreen
from textual.widgets import Button, Footer, Input, Label, Static

from calib.commands.arguments import depth
from calib.errors import harmless
from capture.tui.page import TYPING, Field, onward, typed

ABOUT = (
    "The live picture is shown as a camera without a cover would take it, with straight lines over it. What is at this depth, in metres "
    "from the lens along its axis, is then straight and in its place; u again shows the picture as it is."
)


class DepthScreen(ModalScreen[float | None]):
    """Dismissed with a depth in m, or None."""

    DEFAULT_CSS = """
    DepthScreen { align: center middle; }
    DepthScreen #box { width: 76; height: 13; border: round $primary; padding: 0 1; background: $surface; }
    DepthScreen .row { height: 1; margin: 1 0; }
    DepthScreen .row Label { width: 18; }
    DepthScreen .row Input { width: 1fr; height: 1; }
    DepthScreen #said { height: 1fr; }
    """
    BINDINGS: ClassVar = [
        *TYPING,
        Binding("ctrl+s", "straighten", "Show it straight", key_display="^s", priority=True),
        Binding("escape", "back", "Back", key_display="esc"),
    ]

    def __init__(self, proposed: float) -> None:
        """`proposed`: m."""
        super().__init__()
        self._proposed = proposed

    def compose(self) -> ComposeResult:
        with Vertical(id="box"):
            yield Static(ABOUT, markup=False)
            yield Horizontal(Label("depth in metres"), Field(f"{self._proposed:g}", id="depth", compact=True), classes="row")
            yield Button("Show it straight", variant="primary", compact=True)
            yield Static(id="said", markup=False)
        yield Footer(show_command_palette=False, compact=True)

    @on(Button.Pressed)
    @work(exclusive=True, group="depth")
    async def action_straighten(self) -> None:
        await typed(self)
        try:
            self.dismiss(depth(self.query_one("#depth", Input).value.strip()))
        except argparse.ArgumentTypeError as error:
            self.query_one("#said", Static).update(harmless(f"{error}."))

    def action_onward(self) -> None:
        onward(self)

    def action_back(self) -> None:
        self.dismiss(None)

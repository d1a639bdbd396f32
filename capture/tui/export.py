"""Export: at which depths, in which form, where to; then `calib export` does it."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from textual import on, work
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.message import Message
from textual.screen import ModalScreen
from textual.widgets import Button, Footer, Input, Label, Select, Static

from calib.commands.arguments import depth
from calib.export.formats import FORMATS
from capture.tui.command import calib
from capture.tui.page import TYPING, Field, onward, typed

ABOUT = (
    "Maps that undistort pictures, one for each depth of the scene. Name one depth or more, as in 0.5 1: metres from the lens, along its "
    "axis. npz has map_x and map_y as cv2.remap takes them."
)
DONE = "That is all: esc goes back to the results, and q there ends the program."


class ExportScreen(ModalScreen[None]):
    DEFAULT_CSS = """
    ExportScreen { align: center middle; }
    ExportScreen #box { width: 76; height: 19; border: round $primary; padding: 0 1; background: $surface; }
    ExportScreen .row { height: 1; margin: 0 0 1 0; }
    ExportScreen .row Label { width: 18; }
    ExportScreen .row Input, ExportScreen .row Select { width: 1fr; height: 1; }
    ExportScreen #said { height: 1fr; }
    """
    BINDINGS: ClassVar = [
        *TYPING,
        Binding("ctrl+s", "export", "Export", key_display="^s", priority=True),
        Binding("escape", "dismiss", "Back", key_display="esc"),
    ]

    class Done(Message):
        """The command has ended, perhaps after its screen was left: so the app is told."""

        def __init__(self, screen: "ExportScreen", sentence: str, written: Sequence[Path]) -> None:
            super().__init__()
            self.screen = screen
            self.sentence = sentence
            self.written = written

    def __init__(self, session: Path, calibration: Path) -> None:
        super().__init__()
        self._calibration = calibration
        self._folder = session / "export"

    def compose(self) -> ComposeResult:
        with Vertical(id="box"):
            yield Static(ABOUT, markup=False)
            yield Static()
            yield _row("depths in metres", Field("1.0", id="depths", compact=True))
            forms = [(f"{form.name:<12}{form.summary}", form.name) for form in FORMATS]
            yield _row("form", Select(forms, value=FORMATS[0].name, allow_blank=False, id="form", compact=True))
            yield _row("folder", Field(str(self._folder), id="folder", compact=True))
            yield Button("Export", id="export", variant="primary", compact=True)
            yield Static(id="said", markup=False)
        yield Footer(show_command_palette=False, compact=True)

    @on(Input.Changed, "#depths")
    def _check(self) -> None:
        try:
            self._depths()
        except argparse.ArgumentTypeError as error:
            self._say(str(error))
        else:
            self._say("")

    def _depths(self) -> Sequence[str]:
        texts = self.query_one("#depths", Input).value.replace(",", " ").split()
        for text in texts:
            depth(text)
        return texts

    def action_onward(self) -> None:
        onward(self)

    @on(Button.Pressed)
    @work(exclusive=True, group="export")
    async def action_export(self) -> None:
        await typed(self)
        try:
            depths = self._depths()
        except argparse.ArgumentTypeError as error:
            self._say(str(error))
            return
        folder = self.query_one("#folder", Input).value
        form = str(self.query_one("#form", Select).value)
        at = ["--depth", *depths] if depths else []
        self._say("Being written.")
        self._run(self.app, ["export", str(self._calibration), "--format", form, "-o", folder, *at])

    @work(thread=True, exclusive=True)
    def _run(self, app: App[None], arguments: Sequence[str]) -> None:
        done = calib(arguments)
        written = [Path(line) for line in done.stdout.splitlines()]
        said = [f"Wrote {' '.join(path.name for path in written)}", *done.remarks]
        app.post_message(self.Done(self, "\n".join(said) if done.returncode == 0 else done.sentence, written))

    def tell(self, message: Done) -> None:
        self._say(f"{message.sentence}\n{DONE}" if message.written else message.sentence)

    def _say(self, sentence: str) -> None:
        self.query_one("#said", Static).update(sentence)


def _row(label: str, field: Input | Select[str]) -> Horizontal:
    return Horizontal(Label(label), field, classes="row")

"""Where the pictures come from that a calibration is to be checked with: a camera, or a folder that has them already."""

from asyncio import to_thread
from pathlib import Path
from typing import ClassVar

from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.screen import ModalScreen
from textual.widgets import Button, Footer, Input, Label, Static

from calib.errors import InputError, harmless
from calib.io.yaml_reader import read_yaml
from calib.session.session import session_from_mapping
from capture.session_file import Setup
from capture.sources.registry import open_source
from capture.tui.named import cannot_be_opened, played
from capture.tui.page import TYPING, Field, onward, typed
from capture.typed_path import typed_path

ABOUT = (
    "Whether the calibration still holds, three to five pictures of its board tell, tilted, near and far, and what has changed if it does "
    "not. Name a camera to take them with, or a folder of pictures that were taken later than the calibration, folder:PATH."
)
FOLDER = "folder:"


class CheckSourceScreen(ModalScreen[str]):
    """Dismissed with a source that can be opened, or empty."""

    DEFAULT_CSS = """
    CheckSourceScreen { align: center middle; }
    CheckSourceScreen #box { width: 76; height: 14; border: round $primary; padding: 0 1; background: $surface; }
    CheckSourceScreen .row { height: 1; margin: 1 0; }
    CheckSourceScreen .row Label { width: 18; }
    CheckSourceScreen .row Input { width: 1fr; height: 1; }
    CheckSourceScreen #said { height: 1fr; }
    """
    BINDINGS: ClassVar = [
        *TYPING,
        Binding("ctrl+s", "start", "Start", key_display="^s", priority=True),
        Binding("escape", "back", "Back", key_display="esc"),
    ]

    def __init__(self, source: str) -> None:
        """`source` is proposed."""
        super().__init__()
        self._source = source

    def compose(self) -> ComposeResult:
        with Vertical(id="box"):
            yield Static(ABOUT, markup=False)
            yield Horizontal(Label("pictures from"), Field(self._source, id="source", compact=True), classes="row")
            yield Button("Start", id="start", variant="primary", compact=True)
            yield Static(id="said", markup=False)
        yield Footer(show_command_palette=False, compact=True)

    @on(Button.Pressed)
    @work(exclusive=True, group="check")
    async def action_start(self) -> None:
        await typed(self)
        source = self.query_one("#source", Input).value.strip()
        if typed_path(source).is_dir():
            source = f"{FOLDER}{source}"
        try:
            open_source(source, "pictures from")
        except InputError as error:
            self.query_one("#said", Static).update(harmless(str(error)))
            return
        if played(source) and (shut := await to_thread(cannot_be_opened, source)):
            self.query_one("#said", Static).update(harmless(shut))
            return
        self.dismiss(source)

    def action_onward(self) -> None:
        onward(self)

    def action_back(self) -> None:
        self.dismiss("")


def folder_of(source: str) -> Path | None:
    """The folder that a source plays back, whose pictures need not be taken again."""
    return typed_path(source.removeprefix(FOLDER).partition("?")[0]) if source.startswith(FOLDER) else None


def calibrated(calibration: Path) -> Setup:
    """Board, camera and cover as a calibration's file has them: so the guide knows the lens."""
    said = read_yaml(calibration)
    return session_from_mapping({key: said[key] for key in ("board", "camera", "cover")}, str(calibration))

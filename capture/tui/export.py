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

from calib.commands.arguments import depth, quoted
from calib.errors import harmless
from calib.export.formats import FORMATS
from capture.tui.command import calib
from capture.tui.page import TYPING, Field, onward, typed
from capture.typed_path import typed_path

ABOUT = (
    "Maps that undistort pictures, one for each depth of the scene. Name a depth or more, with a"
    " blank between, in metres from the lens along its axis. npz has map_x and map_y as cv2.remap"
    " takes them."
)
DONE = "That is all: esc goes back to the results, and q there ends the program."
FLAG = ", or replace what is there with --overwrite"
"""The screen has no such flag: a person who wants that uses the command line."""
NO_MAP = (
    "No map, as no depth was named. rays.npz holds the ray of every pixel: name a depth here for a"
    " map, and press ^s again, or esc goes back."
)

# times the farthest board, or the nearest in so many parts: from here on a depth is asked about
FAR_OFF = 3.0


class ExportScreen(ModalScreen[str]):
    """Dismissed with where the last maps were written, in a sentence; empty where none were."""

    DEFAULT_CSS = """
    ExportScreen { align: center middle; }
    ExportScreen #box { width: 76; height: 19; border: round $primary; padding: 0 1; background: $surface; }
    ExportScreen .row { height: 1; margin: 0 0 1 0; }
    ExportScreen .row Label { width: 18; }
    ExportScreen .row Input, ExportScreen .row Select { width: 1fr; height: 1; }
    ExportScreen #said { height: 1fr; }
    """  # noqa: E501
    BINDINGS: ClassVar = [
        *TYPING,
        Binding("ctrl+s", "export", "Export", key_display="^s", priority=True),
        Binding("escape", "back", "Back", key_display="esc"),
    ]

    class Done(Message):
        """The command has ended, perhaps after its screen was left: so the app is told."""

        def __init__(self, screen: "ExportScreen", sentence: str, written: Sequence[Path]) -> None:
            super().__init__()
            self.screen = screen
            self.sentence = sentence
            self.written = written

    def __init__(
        self,
        session: Path,
        calibration: Path,
        depth: float,
        boards: tuple[float, float] | None = None,
        *,
        note: str = "",
    ) -> None:
        """`depth`, in metres, is proposed; `boards`, in metres: from the nearest to the farthest,
        if that is known. `note`: what to know of this calibration before it is exported.
        """
        super().__init__()
        self._note = note
        self._boards = boards
        self._meant: set[str] = set()
        """What was said against depths: to export once more is to mean them."""
        self._depth = depth
        self._calibration = calibration
        self._folder = session / "export"
        self._wrote = ""
        self._wrong = False
        """What stands in the fields is none that could be exported, and the screen says why."""

    def compose(self) -> ComposeResult:
        with Vertical(id="box"):
            yield Static(ABOUT, markup=False)
            yield Static(harmless(self._note), markup=False)
            yield _row("depths in metres", Field(f"{self._depth:g}", id="depths", compact=True))
            forms = [
                (f"{form.name:<12}{form.brief or form.summary}", form.name) for form in FORMATS
            ]
            yield _row(
                "form",
                Select(forms, value=FORMATS[0].name, allow_blank=False, id="form", compact=True),
            )
            yield _row("folder", Field(str(self._folder), id="folder", compact=True))
            yield Button("Export", id="export", variant="primary", compact=True)
            yield Static(id="said", markup=False)
        yield Footer(show_command_palette=False, compact=True)

    @on(Input.Changed)
    def _check(self) -> None:
        self._asked()

    def _asked(self) -> tuple[Sequence[str], Path] | None:
        """The depths and the folder; None where they will not do, and the screen says why."""
        try:
            asked = (
                depths(self.query_one("#depths", Input).value),
                folder(self.query_one("#folder", Input).value),
            )
        except argparse.ArgumentTypeError as error:
            self._wrong = True
            self._say(str(error))
            return None
        self._wrong = False
        self._say("")
        return asked

    def action_back(self) -> None:
        self.dismiss(self._wrote)

    def action_onward(self) -> None:
        onward(self)

    @on(Button.Pressed)
    @work(exclusive=True, group="export")
    async def action_export(self) -> None:
        await typed(self)
        if not (asked := self._asked()):
            return
        at, out = asked
        if self._boards and (far := far_off(at, self._boards)) and far not in self._meant:
            self._meant.add(far)
            self._say(far)
            return
        form = str(self.query_one("#form", Select).value)
        self._say("Being written.")
        self._run(
            self.app,
            [
                "export",
                str(self._calibration),
                "--format",
                form,
                "-o",
                str(out),
                *(["--depth", *at] if at else []),
            ],
        )

    @work(thread=True, exclusive=True)
    def _run(self, app: App[None], arguments: Sequence[str]) -> None:
        done = calib(arguments)
        written = [Path(line) for line in done.stdout.splitlines()]
        said = (
            done.sentence.replace("with -o", "above").replace(FLAG, "")
            if done.returncode
            else _told(written, done.remarks)
        )
        app.post_message(self.Done(self, said, written))

    def tell(self, message: Done) -> None:
        """What stands in the fields may have been changed meanwhile: what is wrong with it stays to
        be read.
        """
        if message.written:
            self._wrote = (
                f"Wrote {len(message.written)} file{'s' * (len(message.written) > 1)} in"
                f" {message.written[0].parent.resolve()}."
            )
        if self._wrong:
            self.notify(message.sentence, markup=False)
        else:
            self._say(
                f"{message.sentence}\n{DONE}"
                if any(map(is_map, message.written))
                else message.sentence
            )

    def _say(self, sentence: str) -> None:
        self.query_one("#said", Static).update(sentence)


def depths(text: str) -> Sequence[str]:
    """Of a list of depths, as they were written."""
    listed = [word.rstrip(",") for word in text.split() if word.strip(",")]
    for word in listed:
        if "," in word:
            raise argparse.ArgumentTypeError(
                f"{quoted(word)} may be one depth or more: {_unmistakably(word)}"
            )
        depth(word)
    return listed


def _unmistakably(word: str) -> str:
    match word.split(","):
        case ["0", decimals] if decimals.isdecimal():
            return f"write 0.{decimals} with a point"
        case [whole, decimals] if whole.isdecimal() and decimals.isdecimal():
            return f"write {whole}.{decimals} with a point, or {whole} {decimals} for two depths"
        case _:
            return "write decimals with a point, and a blank between two depths"


def far_off(listed: Sequence[str], boards: tuple[float, float]) -> str:
    """Of depths at which no board was anywhere near, a sentence; empty where there are none."""
    near, far = boards
    words = [word for word in listed if not near / FAR_OFF <= depth(word) <= far * FAR_OFF]
    if not words:
        return ""
    metres = " and ".join(f"{word} m" for word in words)
    away = f"far from your boards, which were {near:.2f} to {far:.2f} m away"
    return f"{metres} {'are' if words[1:] else 'is'} {away}: press ^s again to export all the same."


def folder(text: str) -> Path:
    """As a shell would take it."""
    if not text.strip():
        raise argparse.ArgumentTypeError("No folder is named: write where the files are to go")
    path = typed_path(text.strip())
    if path.parts[0].startswith("~"):
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} begins in the home of nobody who is known here: write the whole path"
        )
    return path


def is_map(path: Path) -> bool:
    """And not the rays alone."""
    return path.name != "rays.npz"


def _told(written: Sequence[Path], remarks: Sequence[str]) -> str:
    wrote = (
        f"Wrote {' '.join(path.name for path in written)}\nin"
        f" {harmless(str(written[0].parent.resolve()))}"
    )
    return "\n".join([wrote, *([] if any(map(is_map, written)) else [NO_MAP]), *remarks])


def _row(label: str, field: Input | Select[str]) -> Horizontal:
    return Horizontal(Label(label), field, classes="row")

"""Export: the screen that asks for the depths, the format and the folder; then `calib export`
writes the maps, or `calib undistort` the straight pictures.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from textual import on, work
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.events import Key
from textual.message import Message
from textual.widgets import Button, Footer, Input, Label, Select, Static

from calib.commands.arguments import depth, quoted
from calib.errors import harmless
from calib.export.formats import FORMATS
from calib.fitting.supported_depths import doubtful_depths
from calib.session.shapes.layer import MEDIA, WATER
from capture.tui.command import calib
from capture.tui.page import TYPING, Field, focus_next_field, wait_for_typing
from capture.tui.path_suggester import PathSuggester
from capture.tui.sized import Dialog, SizeNotice
from capture.typed_path import expand_typed_path

ABOUT = (
    "Maps that undistort pictures, or the straight pictures, for a depth of the scene in metres"
    " from the lens along its axis. Several depths: 0.5 1 names two."
)
NAME = max(len(form.name) for form in FORMATS) + 2
"""Columns of the name of a form."""
STRAIGHT = "straight"
"""The form of the session's own pictures, undistorted."""
USUAL = ("npz", "opencv", "ros")
"""The forms of the first list, which a phone shows without scrolling.
A second list has the rest."""
WATERS = {"water": f"{MEDIA[WATER]:g}", "sea": "1.34"}
"""The refractive index of each water that a calibration in air has maps for."""
FURTHER = "further"
"""The choice of that second list."""
AIR_ADVICE = (
    "These maps are for air. For use under water, choose the form further, then water or sea."
)
WATER_ADVICE = (
    "These maps are a prediction for an index of {index} outside. calib check compares them with"
    " pictures taken there."
)
NO_DEPTH = "Straight pictures are of a depth: name one, in metres."
EXPORT_DONE = "That is all: esc goes back to the results, q quits."
OVERWRITE_ADVICE = ", or replace what is there with --overwrite"
"""Advice of the command that the screen omits, because it has no such flag."""
NO_MAP = (
    "No map, as no depth was named. rays.npz holds the ray of every pixel: name a depth here for a"
    " map, and press ^s again, or esc goes back."
)

MAX_NAMES = 6
"""Written files that are named."""


class DepthsField(Field):
    """A field for depths, in which q quits, as on the pages: no depth has that letter."""

    async def on_key(self, event: Key) -> None:
        if event.character == "q":
            event.stop()
            event.prevent_default()
            await self.run_action("app.quit")
        else:
            await super().on_key(event)


class ExportScreen(Dialog[str]):
    """A screen that is dismissed with a sentence about the last written maps; empty where none were
    written.
    """

    DEFAULT_CSS = """
    ExportScreen { align: center middle; }
    ExportScreen #box { width: 76; height: 21; padding: 0 1; }
    ExportScreen #box { border: round $primary; background: $surface; }
    ExportScreen .row { height: 1; margin: 0 0 1 0; }
    ExportScreen .row Label { width: 18; }
    ExportScreen .row Input, ExportScreen .row Select { width: 1fr; height: 1; }
    ExportScreen #result { height: 1fr; }
    ExportScreen #said.wrong { color: $text-error; }
    ExportScreen #said.care { color: $text-warning; }
    """
    BINDINGS: ClassVar = [
        *TYPING,
        Binding("ctrl+s", "export", "Export", key_display="^s", priority=True),
        Binding("escape", "back", "Back", key_display="esc"),
        Binding("ctrl+q", "app.quit", "Quit", key_display="^q", priority=True),
        Binding("q", "app.quit", show=False),  # the field of the folder takes it as a letter
        Binding("pageup", "scroll(-3)", show=False),
        Binding("pagedown", "scroll(3)", show=False),
    ]

    class MapsExported(Message):
        """The command has ended, perhaps after its screen was left; so this goes to the app."""

        def __init__(
            self,
            screen: "ExportScreen",
            sentence: str,
            written: Sequence[Path],
            remarks: Sequence[str],
        ) -> None:
            super().__init__()
            self.screen = screen
            self.sentence = sentence
            self.written = written
            self.remarks = remarks

    def __init__(
        self,
        session: Path,
        calibration: Path,
        depth: float,
        boards: tuple[float, float] | None = None,
        *,
        note: str = "",
        in_air: bool = False,
        pictures: Path | None = None,
        has_black_border: bool = False,
    ) -> None:
        """`depth`, in metres, is proposed; `boards`, in metres, is the range from the nearest to
        the farthest board, if it is known. `note` is shown above the fields. `in_air`: the cover
        has air outside, so that maps for water may be wanted. `pictures` is the folder of the
        session's pictures. `has_black_border`: straight ones have a black border, which is
        cropped.
        """
        super().__init__()
        self._note = note
        self._in_air = in_air
        self._boards = boards
        self.is_writing = False
        self._accepted: set[str] = set()
        """The warnings about depths that were shown: to export again is to accept them."""
        self._depth = depth
        self._calibration = calibration
        self._folder = session / "export"
        self._pictures = pictures
        self._crop = ["--crop", "0"] if has_black_border else []
        self._summary = ""
        self.is_invalid = False
        """True if the fields cannot be exported, and the screen says why."""

    def compose(self) -> ComposeResult:
        with Vertical(id="box"):
            yield Static(ABOUT, markup=False)
            yield Static(harmless(self._note), markup=False)
            yield _row(
                "depths in metres", DepthsField(f"{self._depth:g}", id="depths", compact=True)
            )
            forms = [_option(form.name, form.brief or form.summary) for form in FORMATS]
            usual = [form for form in forms if form[1] in USUAL]
            further = [form for form in forms if form[1] not in USUAL]
            first = USUAL[0]
            if self._pictures and self._pictures.is_dir():
                usual.insert(1, _option(STRAIGHT, "the session's pictures, undistorted"))
                if getattr(self.app, "on_phone", False):
                    first = STRAIGHT  # a phone can show them, and cannot use maps
            usual.append(_option(FURTHER, "forms for other programs"))
            if self._in_air:
                waters = [_option(name, f"maps for it, index {n}") for name, n in WATERS.items()]
                further = [*waters, *further]
            yield _row("form", _select("form", usual, first))
            row = _row("which form", _select(FURTHER, further, further[0][1]))
            row.display = False
            yield row
            suggester = PathSuggester(kinds=False)
            yield _row(
                "folder",
                Field(str(self._folder), id="folder", suggester=suggester, compact=True),
            )
            advice = Static(AIR_ADVICE, id="advice", markup=False)
            advice.display = self._in_air
            yield advice
            yield Button("Export", id="export", variant="primary", compact=True)
            with VerticalScroll(id="result", can_focus=False):
                yield Static(id="said", markup=False)
        yield SizeNotice()
        yield Footer(show_command_palette=False, compact=True)

    @on(Select.Changed, "#form")
    def _offer_further(self, event: Select.Changed) -> None:
        self.query_one(f"#row-{FURTHER}").display = event.value == FURTHER
        self._name_medium()

    @on(Select.Changed, f"#{FURTHER}")
    def _name_medium(self) -> None:
        """Say for which medium the chosen maps are."""
        form = str(self.query_one(f"#{FURTHER}", Select).value)
        if self.query_one("#form", Select).value == FURTHER and form in WATERS:
            advice = WATER_ADVICE.format(index=WATERS[form])
        else:
            advice = AIR_ADVICE
        self.query_one("#advice", Static).update(advice)

    @on(Input.Changed)
    def _check(self) -> None:
        self._read_fields()

    def _read_fields(self) -> tuple[Sequence[str], Path] | None:
        """Return the depths and the folder; None where they are invalid, and the screen
        says why.
        """
        try:
            fields = (
                parse_depths(self.query_one("#depths", Input).value),
                parse_folder(self.query_one("#folder", Input).value),
            )
        except argparse.ArgumentTypeError as error:
            self.is_invalid = True
            self._say(f"✗ {error}", tone="wrong")
            return None
        self.is_invalid = False
        self._say("")
        return fields

    def action_back(self) -> None:
        self.dismiss(self._summary)

    def action_scroll(self, by: int) -> None:
        self.query_one("#result").scroll_relative(y=by, animate=False)

    def action_onward(self) -> None:
        focus_next_field(self)

    @on(Button.Pressed)
    @work(exclusive=True, group="export")
    async def action_export(self) -> None:
        await wait_for_typing(self)
        if not (fields := self._read_fields()):
            return
        depths, folder = fields
        if (
            self._boards
            and (warning := warn_of_distance(depths, self._boards))
            and warning not in self._accepted
        ):
            self._accepted.add(warning)
            self._say(warning, tone="care")
            return
        form = str(self.query_one("#form", Select).value)
        if form == FURTHER:
            form = str(self.query_one(f"#{FURTHER}", Select).value)
        if form == STRAIGHT and not depths:
            self.is_invalid = True
            self._say(NO_DEPTH, tone="wrong")
            return
        self._say("Being written.")
        self.is_writing = True
        self._run(self.app, form, depths, folder)

    @work(thread=True, exclusive=True)
    def _run(self, app: App[None], form: str, depths: Sequence[str], folder: Path) -> None:
        at = ["--depth", *depths] if depths else []
        commands = [["export", str(self._calibration), "--format", form, "-o", str(folder), *at]]
        if form == STRAIGHT:
            # the pictures of every depth have the same names
            command = ["undistort", str(self._calibration), str(self._pictures)]
            commands = [
                [
                    *command,
                    "-o",
                    str(folder / f"{STRAIGHT}_{depth}m"),
                    "--depth",
                    depth,
                    *self._crop,
                ]
                for depth in depths
            ]
        remarks: list[str] = []
        if form in WATERS:
            immersed = str(folder / form / "calibration")
            into = ["immerse", str(self._calibration), "--outside-index", WATERS[form]]
            npz = ["export", immersed, "--format", "npz", "-o", str(folder / form), *at]
            commands = [[*into, "-o", immersed], npz]
        written: list[Path] = []
        for command in commands:
            done = calib(command)
            remarks += done.remarks
            if command[0] != "immerse":  # which prints a table
                written += [Path(line) for line in done.stdout.splitlines()]
            if done.returncode:
                break
        sentence = (
            done.sentence.replace("with -o", "above").replace(OVERWRITE_ADVICE, "")
            if done.returncode
            else _describe_straight(written, depths, folder)
            if form == STRAIGHT
            else _describe_files(written)
        )
        app.post_message(self.MapsExported(self, sentence, written, list(dict.fromkeys(remarks))))

    def show_result(self, message: MapsExported) -> None:
        """Show the result. The fields may have changed meanwhile: a message about an invalid field
        stays.
        """
        self.is_writing = False
        if message.written:
            folders = dict.fromkeys(path.parent.resolve() for path in message.written)
            *others, last = map(str, folders)
            place = f"{', '.join(others)} and {last}" if others else last
            count = len(message.written)
            self._summary = f"Wrote {count} file{'s' * (count > 1)} in {place}."
        if self.is_invalid:
            self.notify(message.sentence, markup=False)
        else:
            done = [EXPORT_DONE] if any(map(is_map, message.written)) else []
            if done and self.query_one("#folder").has_focus:
                self.query_one("#export").focus()  # where q is no letter of a folder
            self._say("\n".join([message.sentence, *done, *message.remarks]))

    def _say(self, sentence: str, *, tone: str = "") -> None:
        said = self.query_one("#said", Static)
        said.update(sentence)
        said.set_class(tone == "wrong", "wrong")
        said.set_class(tone == "care", "care")


def parse_depths(text: str) -> Sequence[str]:
    """Return the depths of a list, as they are written."""
    words = [word.rstrip(",") for word in text.split() if word.strip(",")]
    for word in words:
        if "," in word:
            raise argparse.ArgumentTypeError(
                f"{quoted(word)} may be one depth or more: {_suggest_depth(word)}"
            )
        depth(word)
    return words


def _suggest_depth(word: str) -> str:
    match word.split(","):
        case ["0", decimals] if decimals.isdecimal():
            return f"write 0.{decimals} with a point"
        case [whole, decimals] if whole.isdecimal() and decimals.isdecimal():
            return f"write {whole}.{decimals} with a point, or {whole} {decimals} for two depths"
        case _:
            return "write decimals with a point, and a blank between two depths"


def warn_of_distance(depths: Sequence[str], boards: tuple[float, float]) -> str:
    """Return a warning about depths that the boards do not support; empty where there are none."""
    near, far = boards
    doubtful = doubtful_depths(map(depth, depths), near, far)
    words = [word for word in depths if depth(word) in doubtful]
    if not words:
        return ""
    metres = " and ".join(f"{word} m" for word in words)
    distance = f"far from your boards, which were {near:.2f} to {far:.2f} m away"
    return (
        f"{metres} {'are' if words[1:] else 'is'} {distance}: press ^s again to export all the"
        " same."
    )


def parse_folder(text: str) -> Path:
    """Return the folder as a shell would expand it."""
    if not text.strip():
        raise argparse.ArgumentTypeError("No folder is named: write where the files are to go")
    path = expand_typed_path(text.strip())
    if path.parts[0].startswith("~"):
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} begins in the home of an unknown user: write the full path"
        )
    return path


def is_map(path: Path) -> bool:
    """True if the file is a map, not the file of rays."""
    return path.name != "rays.npz"


def _describe_straight(written: Sequence[Path], depths: Sequence[str], folder: Path) -> str:
    count = f"{len(written)} straight picture{'s' * (len(written) > 1)}"
    folders = " and ".join(f"{STRAIGHT}_{depth}m" for depth in depths)
    return f"Wrote {count} into {folders}\nin {harmless(str(folder.resolve()))}"


def _describe_files(written: Sequence[Path]) -> str:
    count = len(written)
    names = " ".join(path.name for path in written[:MAX_NAMES])
    suffix = f" and {count - MAX_NAMES} more" if count > MAX_NAMES else ""
    summary = f"Wrote {names}{suffix}\nin {harmless(str(written[0].parent.resolve()))}"
    return summary if any(map(is_map, written)) else f"{summary}\n{NO_MAP}"


def _option(name: str, summary: str) -> tuple[str, str]:
    return f"{name:<{NAME}}{summary}", name


def _select(name: str, options: Sequence[tuple[str, str]], value: str) -> Select[str]:
    return Select(options, value=value, allow_blank=False, id=name, compact=True)


def _row(label: str, field: Input | Select[str]) -> Horizontal:
    return Horizontal(Label(label), field, classes="row", id=f"row-{field.id}")

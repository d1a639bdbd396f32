"""Set-up: the camera, the board and the cover, every value checked as it is typed."""

from asyncio import to_thread
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, cast

from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Grid, Horizontal, VerticalScroll
from textual.events import DescendantFocus, ScreenResume
from textual.message import Message
from textual.suggester import SuggestFromList
from textual.widget import Widget
from textual.widgets import Button, Input, Label, Select, Static

from calib.errors import InputError, harmless
from calib.io.images import list_images
from calib.session.coding import DICTIONARIES
from calib.session.cover import SHAPES
from capture.session_file import Setup, board_of, read_setup
from capture.sources.registry import SCHEMES, open_source
from capture.tui.camera import Task
from capture.tui.collect import CollectScreen
from capture.tui.doubts import doubts
from capture.tui.draft import Draft, keep, kept
from capture.tui.farewell import fitted
from capture.tui.fit import FitScreen
from capture.tui.form import BOARD, Typed, explained, problem, read_form, write_form
from capture.tui.lacking import lacking, lens_known
from capture.tui.lens import ENOUGH
from capture.tui.lent_lens import lend_lens, lens_of
from capture.tui.named import cannot_be_opened, played, read_like
from capture.tui.opening import OpeningScreen
from capture.tui.page import TYPING, Field, Page, onward, typed
from capture.wrong_folder import check_folder, half

SOURCE_HELP = "Where pictures come from: v4l2:/dev/video0, libcamera:0, rpicam:0, video:FILE, or folder:PATH (pictures, or a session)."
LIKE_HELP = "Another session, its folder: board, cover and lens are taken from there. May stay empty."
LENS_HELP = "Another session, its folder, that knows the lens: that alone is taken from there, into session.yaml."
PHASE_HELP = "First without the cover, to find the lens; then through it, without touching the focus."
OPENS = " enter opens the list, tab goes on."
COVER_ON = "NOW PUT THE COVER ON, and leave the focus alone. "
LIVE = "Then enter on Start."
PLAYED = "Name the source of the pictures through it, then ^s."
BOTH = "The source is a session that has pictures through it as well: ^s goes on with those."
BOARDS = {
    "checkerboard": {"columns": "9", "rows": "6"},
    "charuco": {"columns": "9", "rows": "6", "dictionary": "DICT_4X4_250", "legacy_pattern": "no"},
    "aprilgrid": {"columns": "6", "rows": "6", "spacing": "0.3"},
}
"""What stands in the form before anything is typed."""
EMPTY = Typed(BOARDS["checkerboard"], "cone", {"refractive_index": "1.5", "outside_index": "1", "tilt_deg": "0, 0"})


class SetupScreen(Page):
    DEFAULT_CSS = """
    SetupScreen VerticalScroll { height: 1fr; padding: 0 1; }
    SetupScreen #state { text-style: bold; }
    SetupScreen .row { height: 1; width: 1fr; }
    SetupScreen .row Label { width: 19; }
    SetupScreen .row Input { width: 1fr; }
    SetupScreen .row Select { width: 1fr; }
    SetupScreen #board, SetupScreen #cover { grid-size: 2; grid-rows: 1; grid-gutter: 0 1; height: auto; }
    SetupScreen #start { width: 30; margin: 1 0 0 19; }
    SetupScreen #hint { height: 2; padding: 0 1; color: $text-muted; }
    SetupScreen #problem { height: 3; }
    SetupScreen Select { height: 1; }
    """
    BINDINGS: ClassVar = [
        Binding("ctrl+s", "start", "Start", key_display="^s", priority=True),
        Binding("ctrl+r", "fit", "Fit what there is", key_display="^r", priority=True),
        Binding("ctrl+o", "open", "Results", key_display="^o", priority=True),
        *TYPING,
        Binding("f1", "help", "Help", key_display="F1"),
        Binding("escape", "app.quit", "Quit", key_display="esc"),
    ]

    class Found(Message):
        """The cameras of this machine."""

        def __init__(self, sources: Sequence[str]) -> None:
            super().__init__()
            self.sources = sources

    def __init__(self, session: Path, source: str) -> None:
        super().__init__()
        self.session = session
        self._source = source
        self._like: Setup | None = None
        self._liked = ""
        """The name that `_like` was read from."""
        self._covered = False
        """The person says that the cover is on now."""
        self._doubted: set[str] = set()
        """What was said against a start: to start once more is to mean it."""
        self._helped = False
        """The help has just been read: everything stands as it was typed."""
        self._proposed: bool | None = None
        """To record without the cover: what the program chose last. None: nothing yet."""
        self._refused = ""
        """Why a start was refused, until the field is looked at that it led to."""
        self._shut = ("", "")
        """The source that could not be opened last, and why."""

    def step(self) -> str:
        return "Set-up"

    def body(self) -> ComposeResult:
        with VerticalScroll(can_focus=False):
            yield Static(id="state", markup=False)
            yield _row("source", Field(self._source, id="source", compact=True))
            yield Static("", id="cameras", markup=False)
            yield _row("like (optional)", Field(id="like", compact=True))
            yield _row("board type", Select([(kind, kind) for kind in BOARD], value=EMPTY.kind, allow_blank=False, id="kind", compact=True))
            yield Grid(id="board")
            yield _row(
                "cover shape", Select([(shape, shape) for shape in SHAPES], value="cone", allow_blank=False, id="shape", compact=True)
            )
            yield Grid(id="cover")
            phases = [("without the cover, into bare/", True), ("through the cover, into frames/", False)]
            yield _row("record now", Select(phases, allow_blank=False, id="phase", compact=True))
            yield Button("Start", id="start", variant="primary", compact=True)
        yield Static(id="hint", markup=False)
        yield Static(id="problem", classes="banner", markup=False)

    def on_mount(self) -> None:
        self._find_cameras()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        del parameters
        if action == "open":
            return fitted(self.session) is not None
        return action != "fit" or bool((self.session / "session.yaml").exists() and self._taken(False))

    def action_help(self) -> None:
        self._helped = True
        super().action_help()

    @work(exclusive=True, group="start")
    async def action_fit(self) -> None:
        """A session that was recorded before needs no camera any more."""
        await typed(self)
        try:
            await self._borrow()
        except InputError as error:
            await self._lead(str(error))
            return
        if lack := lacking(self.session):
            self._say(lack)
        elif self.is_current:
            self.app.push_screen(FitScreen(self.session))

    def action_open(self) -> None:
        if folder := fitted(self.session):
            self.app.push_screen(OpeningScreen(self.session, folder))

    @on(ScreenResume)
    async def _take_up(self) -> None:
        """What the folder says stands above what was typed."""
        self.refresh_bindings()
        if self._helped:
            self._helped = False
            return
        self._say("")
        described = (self.session / "session.yaml").exists()
        self._restore()
        state = f"{self.session}: a new session."
        if described:
            try:
                self._like = read_setup(self.session / "session.yaml")
                await self._fill(self._like)
            except InputError as error:
                self._say(str(error))
            state = f"{self.session}: continued, {_views(self._taken(True))} without cover and {_views(self._taken(False))} through it."
            if fitted(self.session):
                state += " It is fitted: ^o opens its results."
            state += " What is grey stands in its session.yaml: correct it there."
            self._open_like()
        elif not self.query("#board Input"):
            await self._begin_anew()
        source = self.query_one("#source", Input)
        both = half(source.value, covered=False) != source.value
        go_on = BOTH if both else PLAYED if played(source.value) else LIVE
        self.query_one("#state", Static).update(COVER_ON + go_on if self._covered else harmless(state))
        for each in self.query("#kind, #board Input, #cover Input, #shape"):
            each.disabled = described
        self._propose()
        if described and self._source and (both or not (self._covered and played(source.value))):
            self.query_one("#start").focus()
        else:
            source.focus().action_select_all()  # what is typed replaces it

    def _open_like(self) -> None:
        """Of a session that exists: for as long as its lens is missing."""
        like = self.query_one("#like", Input)
        like.disabled = self._like is None or lens_known(self.session, self._like)
        if not like.disabled:  # what it named before had no lens to give
            like.value = self._liked = ""

    async def _begin_anew(self) -> None:
        """With what was typed when the program ended last, if anything was."""
        draft = kept(self.session)
        typed = draft.typed if draft else EMPTY
        await self._show(typed)
        self.query_one("#kind", Select).value = typed.kind
        self.query_one("#shape", Select).value = typed.shape
        if draft:
            self.query_one("#like", Input).value = draft.like
            with suppress(InputError):  # said as the field is looked at
                self._like = read_like(draft.like)
                self._liked = draft.like

    def _restore(self) -> None:
        """Where pictures came from last, and which: neither stands in the folder."""
        if self._proposed is not None or not (draft := kept(self.session)):
            return
        source = self.query_one("#source", Input)
        source.value = source.value or draft.source
        if draft.bare is not None:
            self.query_one("#phase", Select).value = draft.bare
            self._proposed = not draft.bare

    @on(Select.Changed, "#phase")
    def _keep(self) -> None:
        if self.query("#board Input"):
            source, like = (self.query_one(each, Input).value for each in ("#source", "#like"))
            bare = cast(bool, self.query_one("#phase", Select).value)
            keep(self.session, Draft(self._typed(), source, like, None if bare == self._proposed else bare))

    def _typed(self) -> Typed:
        texts = {each.name or "": each.value for each in self.query("#board Input, #cover Input").results(Input)}
        shape, kind = (str(self.query_one(each, Select).value) for each in ("#shape", "#kind"))
        board = {key: texts.get(key, "") for key in BOARD[kind]}
        return Typed(board, shape, {quantity.key: texts.get(quantity.key, "") for quantity in SHAPES[shape]}, kind)

    def _taken(self, bare: bool) -> int:
        folder = self.session / ("bare" if bare else "frames")
        return len(list_images(folder)) if folder.is_dir() else 0

    def _bare_is_missing(self) -> bool:
        if self.query_one("#shape", Select).value == "none" or (self._like and self._like[1].intrinsics):
            return False
        return self._taken(True) < ENOUGH

    def _propose(self) -> None:
        """What to record now; but what the person chose stays, be it by the field or by going on from the bare step."""
        phase = self.query_one("#phase", Select)
        if self._covered:
            phase.value = False
        elif self._proposed is None or phase.value == self._proposed:
            phase.value = self._proposed = self._bare_is_missing()

    @work(thread=True, exclusive=True, group="cameras")
    def _find_cameras(self) -> None:
        found = [camera for scheme in SCHEMES for camera in scheme.backend().inventory().cameras if not camera.problem]
        self.post_message(self.Found([camera.source for camera in found]))

    @on(Found)
    def _offer(self, message: Found) -> None:
        field = self.query_one("#source", Input)
        field.suggester = SuggestFromList(message.sources)
        words = f"found here: {', '.join(message.sources)}" if message.sources else "no camera found here; folder:PATH plays back pictures"
        self.query_one("#cameras", Static).update(" " * 19 + harmless(words))
        if message.sources and not field.value:
            field.value = message.sources[0]

    @on(Select.Changed, "#kind")
    async def _other_board(self) -> None:
        kind = str(self.query_one("#kind", Select).value)
        if [each.name for each in self.query("#board Input")] != list(BOARD[kind]):
            await self._show_fields("#board", BOARD[kind], BOARDS[kind])
        self._keep()

    @on(Select.Changed, "#shape")
    async def _reshape(self) -> None:
        shape = str(self.query_one("#shape", Select).value)
        if [each.name for each in self.query("#cover Input")] != [quantity.key for quantity in SHAPES[shape]]:
            await self._show_fields("#cover", [quantity.key for quantity in SHAPES[shape]], EMPTY.cover)
        self._keep()
        self._propose()

    async def _fill(self, setup: Setup) -> None:
        typed = write_form(setup[0], setup[2])
        await self._show(typed)
        self.query_one("#kind", Select).value = typed.kind
        self.query_one("#shape", Select).value = typed.shape

    async def _show(self, typed: Typed) -> None:
        await self._show_fields("#board", BOARD[typed.kind], typed.board)
        await self._show_fields("#cover", [quantity.key for quantity in SHAPES[typed.shape]], typed.cover)

    async def _show_fields(self, place: str, keys: Sequence[str], texts: Mapping[str, str]) -> None:
        grid = self.query_one(place, Grid)
        async with self.batch():
            await grid.remove_children()
            await grid.mount_all(_row(key, _field(key, texts.get(key, ""))) for key in keys)

    @on(Input.Changed)
    async def _check(self, event: Input.Changed) -> None:
        field = event.input
        self._keep()
        await self._mark(field)

    async def _mark(self, field: Input) -> None:
        """Beside the field, whether it is wrong; and below, why."""
        wrong = await self._wrong(field)
        name = field.name or field.id
        label = next(iter(self.query(f"#label-{name}").results(Label)), None)
        if label is None:  # the field has gone meanwhile
            return
        field.set_class(wrong is not None and bool(field.value), "wrong")
        words = str(label.content).lstrip("✗ ")
        label.update(f"✗ {words}" if wrong and field.value else words)
        self._say(wrong if wrong and field.value else "")

    async def _wrong(self, field: Input) -> str | None:
        try:
            if field.id == "source":
                open_source(field.value, "source")
                if field.value == self._shut[0]:
                    return self._shut[1]
            elif field.id == "like":
                await self._follow(field.value)
            else:
                return problem(field.name or "", field.value, *(str(self.query_one(each, Select).value) for each in ("#shape", "#kind")))
        except InputError as error:
            return str(error)
        return None

    async def _follow(self, like: str) -> None:
        """Take over what another session says, once for every name that is typed."""
        if like == self._liked or self.query_one("#like").disabled:
            return
        self._like, self._liked = None, ""
        described = (self.session / "session.yaml").exists()
        if setup := lens_of(self.session, like) if described else read_like(like):
            self._like = setup
            if not described:
                await self._fill(setup)
            self._propose()
        self._liked = like

    async def _borrow(self) -> None:
        """What another session gives: to one that exists, its lens."""
        like = self.query_one("#like", Input)
        await self._follow(like.value)
        if self._like and like.value.strip() and not like.disabled and (self.session / "session.yaml").exists():
            lend_lens(self.session, self._like)
            like.disabled = True

    @on(DescendantFocus)
    async def _explain(self, event: DescendantFocus) -> None:
        """What the field is for, and what is wrong with it: nothing of another one stays."""
        like_help = LENS_HELP if (self.session / "session.yaml").exists() else LIKE_HELP
        texts = {"source": SOURCE_HELP, "like": like_help, "phase": PHASE_HELP, "start": "Enter begins to record."}
        widget, kind = event.widget, str(self.query_one("#kind", Select).value)
        key = widget.id or widget.name or ""
        if not key:  # the list of a choice: its hint stays
            return
        listed = OPENS if isinstance(event.widget, Select) else ""
        self.query_one("#hint", Static).update(texts.get(key, explained(key, kind)) + listed)
        wrong = await self._wrong(widget) if isinstance(widget, Input) and widget.value else None
        self._say(wrong or self._refused)
        self._refused = ""

    def action_onward(self) -> None:
        onward(self)

    @on(Button.Pressed, "#start")
    @work(exclusive=True, group="start")
    async def action_start(self) -> None:
        await typed(self)
        self.call_later(self._begin)

    async def _begin(self) -> None:
        try:
            await self._borrow()
            task = self._read()
        except InputError as error:
            await self._lead(str(error))
            return
        for said, field in doubts(task):
            if said not in self._doubted:
                self._doubted.add(said)
                self._lead_to(self.query_one(f"#{field}"), said)
                return
        if played(task.source) and (shut := await to_thread(cannot_be_opened, task.source)):
            source = self.query_one("#source", Input)
            self._shut = source.value, shut
            await self._mark(source)
            source.focus()
            return
        self._source = task.source
        if self.is_current:  # and not started by the same key already
            self.app.push_screen(CollectScreen(task), self._cover_on)

    async def _lead(self, sentence: str) -> None:
        """To the first field that will not do, and say why the start is refused."""
        self._say(sentence)
        for field in self.query(Input):
            if not field.disabled and await self._wrong(field):
                self._lead_to(field, sentence)
                return

    def _lead_to(self, field: Widget, sentence: str) -> None:
        self._say(sentence)
        if not field.has_focus:
            self._refused = sentence  # looking at a field says what is wrong with it, and of an empty one nothing
            field.focus()

    def _cover_on(self, wanted: bool | None) -> None:
        """Back from recording without the cover, perhaps to go on through it."""
        self._covered = bool(wanted)

    def _read(self) -> Task:
        texts = {each.name or each.id or "": each.value for each in self.query(Input)}
        open_source(texts["source"], "source")
        if (self.session / "session.yaml").exists():
            asked = read_setup(self.session / "session.yaml")
            board_of(self.session, None)
        else:
            asked = read_form(self._typed(), self._like[1] if self._like else None)
        task = Task(self.session, texts["source"], asked, bare=cast(bool, self.query_one("#phase", Select).value))
        if asked[2].shape == "none":
            return task
        check_folder(wanted := half(task.source, covered=task.covered), covered=task.covered)
        return replace(task, source=wanted)

    def _say(self, sentence: str) -> None:
        self.query_one("#problem", Static).update(sentence)


def _row(label: str, field: Input | Select[Any]) -> Horizontal:
    return Horizontal(Label(label, id=f"label-{field.name or field.id}"), field, classes="row")


def _field(key: str, text: str) -> Field:
    suggested = SuggestFromList(DICTIONARIES, case_sensitive=False) if key == "dictionary" else None
    return Field(text, name=key, suggester=suggested, compact=True)


def _views(count: int) -> str:
    return f"{count} view{'s' * (count != 1)}"

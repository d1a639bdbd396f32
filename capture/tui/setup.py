"""Set-up: the camera, the board and the cover, every value checked as it is typed."""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.events import DescendantFocus, ScreenResume
from textual.widget import Widget
from textual.widgets import Button, Input, Select, Static

from calib.errors import InputError, RefracalError, harmless
from capture.session_file import board_of, read_setup
from capture.source_folder import check_source_folder, select_pictures
from capture.sources.registry import open_source
from capture.tui.board_and_cover import EMPTY, BoardAndCover
from capture.tui.camera import Task
from capture.tui.collect import CollectScreen
from capture.tui.draft import Draft, keep, kept
from capture.tui.farewell import fitted
from capture.tui.fit import FitScreen
from capture.tui.fit_requirements import lacking
from capture.tui.form import problem, read_form, write_form
from capture.tui.lens import ENOUGH
from capture.tui.like_field import Like
from capture.tui.opening import OpeningScreen
from capture.tui.page import TYPING, Page, onward, typed
from capture.tui.phase import Phase
from capture.tui.references import played
from capture.tui.retake import set_bare_aside
from capture.tui.row import Row
from capture.tui.session_state import described, state, taken
from capture.tui.setup_texts import OPENS, cover_on, help_of
from capture.tui.source import Source
from capture.tui.start_warnings import doubts


class SetupScreen(Page):
    DEFAULT_CSS = """
    SetupScreen VerticalScroll { height: 1fr; padding: 0 1; }
    SetupScreen #state { text-style: bold; }
    SetupScreen #start { width: 30; margin: 1 0 0 19; }
    SetupScreen #hint { height: 2; padding: 0 1; color: $text-muted; }
    SetupScreen #problem { height: 3; }
    """
    BINDINGS: ClassVar = [
        Binding("ctrl+s", "start", "Start", key_display="^s", priority=True),
        Binding("ctrl+r", "fit", "Fit what there is", key_display="^r", priority=True),
        Binding("ctrl+o", "open", "Results", key_display="^o", priority=True),
        *TYPING,
        Binding("f1", "help", "Help", key_display="F1"),
        Binding("escape", "app.quit", "Quit", key_display="esc"),
    ]

    def __init__(self, session: Path, source: str) -> None:
        super().__init__()
        self.session = session
        self._named = source
        """The source that was named when the program was started, or that was recorded from last.
        """
        self._source = Source(source)
        self._like = Like(session)
        self._form = BoardAndCover()
        self._phase = Phase()
        self._covered = False
        """The person says that the cover is on now."""
        self._wrong_board = ""
        """What was said of a source in which there was no such board."""
        self._doubted: set[str] = set()
        """What was said against a start: to start once more is to mean it."""
        self._helped = False
        """The help has just been read: everything stands as it was typed."""
        self._refused = ""
        """Why a start was refused, until the field is looked at that it led to."""

    def step(self) -> str:
        return "Set-up"

    def body(self) -> ComposeResult:
        with VerticalScroll(can_focus=False):
            yield Static(id="state", markup=False)
            yield self._source
            yield Row("like (optional)", self._like)
            yield self._form
            yield Row("record now", self._phase)
            yield Button("Start", id="start", variant="primary", compact=True)
        yield Static(id="hint", markup=False)
        yield Static(id="problem", classes="banner", markup=False)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        del parameters
        if action == "open":
            return fitted(self.session) is not None
        return action != "fit" or bool(described(self.session) and taken(self.session, bare=False))

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
        continued = described(self.session)
        self._restore()
        if continued:
            await self._continue()
        elif not self._form.filled:
            await self._begin_anew()
        source = self._source.field
        both = select_pictures(source.value, covered=False) != source.value
        there = taken(self.session, bare=False)
        words = (
            cover_on(source.value, both=both, there=there)
            if self._covered
            else harmless(state(self.session))
        )
        self.query_one("#state", Static).update(words)
        self._form.set_locked(continued)
        self._phase.offer(taken(self.session, bare=True))
        self._propose()
        if self._wrong_board and not continued:
            self._lead_to(self._form.first, self._wrong_board)
            self._wrong_board = ""
        elif continued and self._named and (both or not (self._covered and played(source.value))):
            self.query_one("#start").focus()
        else:
            source.focus().action_select_all()  # what is typed replaces it

    async def _continue(self) -> None:
        try:
            board, _, cover = self._like.setup = read_setup(self.session / "session.yaml")
            await self._form.show(write_form(board, cover))
        except InputError as error:
            self._say(str(error))
        self._like.open()

    async def _begin_anew(self) -> None:
        """With what was typed when the program ended last, if anything was."""
        draft = kept(self.session)
        await self._form.show(draft.typed if draft else EMPTY)
        if draft:
            self._like.restore(draft.like)

    def _restore(self) -> None:
        """Where pictures came from last, and which: neither stands in the folder."""
        if self._phase.untouched and (draft := kept(self.session)):
            self._source.field.value = self._source.field.value or draft.source
            self._phase.restore(draft.bare)

    @on(Select.Changed, "#phase")
    def _keep(self) -> None:
        if self._form.filled:
            keep(
                self.session,
                Draft(
                    self._form.typed, self._source.field.value, self._like.value, self._phase.chosen
                ),
            )

    @on(Select.Changed, "#kind, #shape")
    async def _reshape(self) -> None:
        await self._form.reshape()
        self._keep()
        self._propose()

    def _propose(self) -> None:
        """What to record now; but what the person chose stays, be it by the field or by going on
        from the bare step.
        """
        if self._covered:
            self._phase.bare = False
        else:
            self._phase.propose(self._bare_is_missing())

    def _bare_is_missing(self) -> bool:
        if self._form.shape == "none" or (self._like.setup and self._like.setup[1].intrinsics):
            return False
        return taken(self.session, bare=True) < ENOUGH

    @on(Input.Changed)
    async def _check(self, event: Input.Changed) -> None:
        self._keep()
        await self._mark(event.input)

    async def _mark(self, field: Input) -> None:
        """Beside the field, whether it is wrong; and below, why."""
        wrong = await self._wrong(field)
        if (
            isinstance(row := field.parent, Row) and row.is_attached
        ):  # the field has not gone meanwhile
            said = wrong if wrong and field.value else ""
            row.mark(wrong=bool(said))
            self._say(said)

    async def _wrong(self, field: Input) -> str | None:
        try:
            if field is self._source.field:
                self._source.check()
            elif field is self._like:
                await self._follow()
            else:
                return problem(field.name or "", field.value, self._form.shape, self._form.kind)
        except InputError as error:
            return str(error)
        return None

    async def _follow(self) -> None:
        """Take over what another session says."""
        if setup := self._like.follow():
            if not described(self.session):
                await self._form.show(write_form(setup[0], setup[2]))
            self._propose()

    async def _borrow(self) -> None:
        """What another session gives: to one that exists, its lens."""
        await self._follow()
        self._like.lend()

    @on(DescendantFocus)
    async def _explain(self, event: DescendantFocus) -> None:
        """What the field is for, and what is wrong with it: nothing of another one stays."""
        widget = event.widget
        key = widget.id or widget.name or ""
        if not key:  # the list of a choice: its hint stays
            return
        listed = OPENS if isinstance(widget, Select) else ""
        self.query_one("#hint", Static).update(
            help_of(key, self._form.kind, self._form.shape, continued=described(self.session))
            + listed
        )
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
        if not await self._source.opens(task.source):
            await self._mark(self._source.field)
            self._source.field.focus()
            return
        self._named = task.source
        if self.is_current and self._cleared():  # and not started by the same key already
            screen = CollectScreen(task)
            self.app.push_screen(screen, lambda covered: self._back(screen, covered=bool(covered)))

    def _cleared(self) -> bool:
        """Of what is to be taken anew; if that cannot be, the screen says why."""
        try:
            if self._phase.anew:
                set_bare_aside(self.session)
        except RefracalError as error:
            self._say(str(error))
            return False
        return True

    async def _lead(self, sentence: str) -> None:
        """To the first field that will not do, and say why: it, or the start if that refuses what
        each field by itself may say.
        """
        self._say(sentence)
        fields = [field for field in self.query(Input) if not field.disabled]
        for field in fields:
            if wrong := await self._wrong(field):
                self._lead_to(field, wrong)
                return
        if named := next(
            (field for field in fields if field.name and f".{field.name} " in sentence), None
        ):
            self._lead_to(named, sentence)

    def _lead_to(self, field: Widget, sentence: str) -> None:
        self._say(sentence)
        if not field.has_focus:
            # looking at a field says what is wrong with it, and of an empty one nothing
            self._refused = sentence
            field.focus()

    def _back(self, screen: CollectScreen, *, covered: bool) -> None:
        """From recording without the cover, perhaps to go on through it; or from a source in which
        there was no such board.
        """
        self._covered, self._wrong_board = covered, screen.wrong_board

    def _read(self) -> Task:
        source = self._source.field.value
        open_source(source, "source")
        if described(self.session):
            asked = read_setup(self.session / "session.yaml")
            board_of(self.session, None)
        else:
            asked = read_form(self._form.typed, self._like.setup[1] if self._like.setup else None)
        task = Task(self.session, source, asked, bare=self._phase.bare)
        if asked[2].shape == "none":
            return task
        check_source_folder(
            wanted := select_pictures(task.source, covered=task.covered), covered=task.covered
        )
        return replace(task, source=wanted)

    def _say(self, sentence: str) -> None:
        self.query_one("#problem", Static).update(sentence)

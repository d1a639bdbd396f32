"""Set-up: the screen for the camera, the board and the cover, with every value checked as it is
typed.
"""

from asyncio import to_thread
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
from capture.source_folder import (
    check_source_folder,
    describe_repeat,
    may_show_cover,
    repeat_sentence,
    select_pictures,
)
from capture.sources.registry import full_source, is_recorded_source, open_source
from capture.tui.board_and_cover import EMPTY_FORM, BoardAndCover
from capture.tui.camera import Task
from capture.tui.collect import CollectScreen
from capture.tui.corrected_fields import in_form_words, label_of
from capture.tui.draft import Draft, load_draft, save_draft
from capture.tui.farewell import calibration_folder
from capture.tui.fit import FitScreen
from capture.tui.fit_requirements import find_missing
from capture.tui.form import FORM_NAME, FormTexts, find_problem, read_form, write_form
from capture.tui.lens import ENOUGH_BARE_VIEWS
from capture.tui.like_field import LikeField
from capture.tui.opening import OpeningScreen
from capture.tui.page import TYPING, Page, focus_next_field, wait_for_typing
from capture.tui.phase import PhaseField
from capture.tui.retake import set_bare_aside
from capture.tui.row import Row
from capture.tui.session_edit import write_edits
from capture.tui.session_state import count_pictures, describe_session, has_session_file
from capture.tui.setup_texts import OPEN_LIST, VALUES, VALUES_AND_FIT, cover_on_text, help_for
from capture.tui.source import SourceField
from capture.tui.start_warnings import find_warnings


class SetupScreen(Page):
    DEFAULT_CSS = """
    SetupScreen VerticalScroll { height: 1fr; padding: 0 1; }
    SetupScreen Input > .input--placeholder { color: $text-warning; }
    SetupScreen #now { height: auto; }
    SetupScreen #state { text-style: bold; }
    SetupScreen #start { width: 30; margin: 1 0 0 19; }
    SetupScreen #hint { height: 2; padding: 0 1; color: $text-muted; }
    SetupScreen #problem { height: auto; min-height: 3; max-height: 6; }
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
        self._last_source = source
        """The source that was named at the start of the program, or the source of the last
        recording.
        """
        self._source = SourceField(source)
        self._last_recording: tuple[str, bool] | None = None
        """The source of the last recording, and whether the cover was off."""
        self._like = LikeField(session)
        self._form = BoardAndCover()
        self._phase = PhaseField()
        self._cover_is_on = False
        """True if the person says that the cover is on now."""
        self._correction: tuple[str, str] | None = None
        """The name of the field that a later page wants corrected, and the sentence about it; both
        empty if the person just wants to see the values.
        """
        self._accepted: set[tuple[str, str]] = set()
        """The warnings that were shown before a start: to start again is to accept them."""
        self._help_closed = False
        """True if the help has just been closed: everything stays as it was typed."""
        self._described: FormTexts | None = None
        """The values of session.yaml as the form has shown them; None where there are none."""
        self._refusal = ""
        """The reason why a start was refused, until its field gets the focus."""

    def step(self) -> str:
        return "Set-up"

    def body(self) -> ComposeResult:
        yield Static(id="now", classes="banner", markup=False)
        with VerticalScroll(can_focus=False):
            yield Static(id="state", markup=False)
            yield self._source
            yield Row(label_of("like"), self._like)
            yield self._form
            yield Row("record now", self._phase)
            yield Button("Start", id="start", variant="primary", compact=True)
        yield Static(id="hint", markup=False)
        yield Static(id="problem", classes="banner", markup=False)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        del parameters
        if action == "open":
            return calibration_folder(self.session) is not None
        return action != "fit" or bool(
            has_session_file(self.session) and count_pictures(self.session, bare=False)
        )

    def action_help(self) -> None:
        self._help_closed = True
        super().action_help()

    @work(exclusive=True, group="start")
    async def action_fit(self) -> None:
        """Fit a recorded session, which needs no camera any more."""
        await wait_for_typing(self)
        try:
            await self._apply_like()
            self._write_edits()
        except RefracalError as error:
            await self._show_error(str(error))
            return
        if lack := find_missing(self.session):
            self._show_problem(lack)
        elif self.is_current:
            self.app.push_screen(FitScreen(self.session))

    def action_open(self) -> None:
        if folder := calibration_folder(self.session):
            self.app.push_screen(OpeningScreen(self.session, folder))

    @on(ScreenResume)
    async def _resume(self) -> None:
        """Show the folder's state above the typed texts."""
        self.refresh_bindings()
        if self._help_closed:
            self._help_closed = False
            return
        self._show_problem("")
        is_described = has_session_file(self.session)
        self._restore()
        if is_described:
            await self._show_described()
        elif not self._form.filled:
            await self._show_new()
        source = self._source.field
        has_both = select_pictures(source.value, covered=False) != source.value
        covered_views = count_pictures(self.session, bare=False)
        instruction = self.query_one("#now", Static)
        instruction.display = self._cover_is_on
        instruction.update(
            cover_on_text(source.value, same_source=has_both, recorded_views=covered_views)
            if self._cover_is_on
            else ""
        )
        state = self.query_one("#state", Static)
        state.display = not self._cover_is_on
        state.update(harmless(describe_session(self.session)))
        self._phase.offer(count_pictures(self.session, bare=True))
        self._propose()
        if self._correction:
            self._focus_correction(*self._correction)
            self._correction = None
        elif (
            is_described
            and self._last_source
            and (has_both or not (self._cover_is_on and is_recorded_source(source.value)))
        ):
            self.query_one("#start").focus()
        else:
            source.focus().action_select_all()  # typed text replaces it

    def correct(self, field: str, sentence: str) -> None:
        """Show this sentence at a field once the screen is in front again.

        Args:
            field: its name; empty for the first value of the board.
            sentence: empty for one on how to go on.
        """
        self._correction = field, sentence
        self._cover_is_on = False

    def _focus_correction(self, name: str, sentence: str) -> None:
        if not name:
            value = self._source.field if self._form.first.disabled else self._form.first
            can_fit = self.check_action("fit", ())
            self._focus_error(value, sentence or (VALUES_AND_FIT if can_fit else VALUES))
            return
        fields = self.query("Input, Select").results(Widget)
        wanted = (field for field in fields if name in (field.name, field.id))
        field = next((field for field in wanted if not field.disabled), self._source.field)
        self._focus_error(field, sentence)

    async def _show_described(self) -> None:
        """Show the values of session.yaml, unless they are there, perhaps corrected meanwhile."""
        try:
            board, _, cover = self._like.setup = read_setup(self.session / "session.yaml")
            if self._described != (described := write_form(board, cover)):
                await self._form.show(described)
            self._described = described
        except InputError as error:
            self._described = None
            self._show_problem(str(error))
        self._form.set_locked(self._described is None)
        self._like.enable()

    async def _show_new(self) -> None:
        """Show the texts that were typed before the program ended last, if there are any."""
        draft = load_draft(self.session)
        await self._form.show(draft.typed if draft else EMPTY_FORM, stated=False)
        if draft:
            self._like.restore(draft.like)

    def _restore(self) -> None:
        """Restore the last source and phase: the folder contains neither."""
        if self._phase.is_untouched and (draft := load_draft(self.session)):
            self._source.field.value = self._source.field.value or draft.source
            self._phase.restore(draft.bare)

    @on(Select.Changed, "#phase")
    def _keep(self) -> None:
        if self._form.filled:
            save_draft(
                self.session,
                Draft(
                    self._form.typed, self._source.field.value, self._like.value, self._phase.choice
                ),
            )

    @on(Select.Changed, "#kind, #shape")
    async def _reshape(self, event: Select.Changed) -> None:
        await self._form.reshape()
        if event.select.has_focus:
            self._show_help(event.select.id or "", OPEN_LIST)
        self._keep()
        self._propose()

    def _propose(self) -> None:
        """Propose the phase. The person's choice stays, whether made in the field or by going on
        from the bare step.
        """
        if self._cover_is_on:
            self._phase.bare = False
        else:
            shows_cover = may_show_cover(self._source.field.value)
            self._phase.propose(self._bare_is_missing() and not shows_cover)

    def _is_phase_guessed(self) -> bool:
        """Return True if the program has chosen the phase by the source alone."""
        is_given = self._cover_is_on or self._phase.choice is not None
        return not is_given and self._bare_is_missing()

    def _bare_is_missing(self) -> bool:
        if self._form.shape == "none" or (self._like.setup and self._like.setup[1].intrinsics):
            return False
        return count_pictures(self.session, bare=True) < ENOUGH_BARE_VIEWS

    @on(Input.Changed)
    async def _check(self, event: Input.Changed) -> None:
        self._keep()
        if event.input is self._source.field:
            self._propose()
        await self._mark(event.input)

    async def _mark(self, field: Input) -> None:
        """Mark the field if it is wrong, and show the reason below."""
        problem = await self._find_problem(field)
        if (
            isinstance(row := field.parent, Row) and row.is_attached
        ):  # the field is still on the screen
            sentence = problem if problem and field.value else ""
            row.mark(wrong=bool(sentence))
            self._show_problem(sentence)

    async def _find_problem(self, field: Input) -> str | None:
        try:
            if field is self._source.field:
                self._source.check()
            elif field is self._like:
                await self._follow_like()
            else:
                return find_problem(
                    field.name or "", field.value, self._form.shape, self._form.kind
                )
        except InputError as error:
            return str(error)
        return None

    async def _follow_like(self) -> None:
        """Take over the values of another session."""
        if setup := self._like.read_if_changed():
            if not has_session_file(self.session):
                await self._form.show(write_form(setup[0], setup[2]))
            self._propose()

    async def _apply_like(self) -> None:
        """Take over the values of another session; write its lens into an existing one."""
        await self._follow_like()
        self._like.transfer_lens()

    def _write_edits(self) -> None:
        """Write the corrected values of a described session."""
        if self._described and has_session_file(self.session):
            write_edits(self.session, self._form.typed)
            self._described = self._form.typed

    @on(DescendantFocus)
    async def _explain(self, event: DescendantFocus) -> None:
        """Explain the field and its error; nothing about another field stays."""
        widget = event.widget
        key = widget.id or widget.name or ""
        # the list of a choice has no key: its hint stays. A field deep in the form may report its
        # focus after the next field has it
        if not key or not widget.has_focus:
            return
        self._show_help(key, OPEN_LIST if isinstance(widget, Select) else "")
        problem = (
            await self._find_problem(widget) if isinstance(widget, Input) and widget.value else None
        )
        self._show_problem(problem or self._refusal)
        self._refusal = ""

    def _show_help(self, key: str, list_hint: str = "") -> None:
        """Show the help for a field, of the board and the cover at hand."""
        continued = has_session_file(self.session)
        words = help_for(key, self._form.kind, self._form.shape, continued=continued)
        self.query_one("#hint", Static).update(words + list_hint)

    def action_onward(self) -> None:
        focus_next_field(self)

    @on(Button.Pressed, "#start")
    @work(exclusive=True, group="start")
    async def action_start(self) -> None:
        await wait_for_typing(self)
        self.call_later(self._start)

    async def _start(self) -> None:
        try:
            await self._apply_like()
            self._write_edits()
            task = self._read()
        except RefracalError as error:
            await self._show_error(str(error))
            return
        if not await self._source.can_open(task.source):
            await self._mark(self._source.field)
            self._source.field.focus()
            return
        if repeat := await to_thread(self._describe_repeat, task):
            self._focus_error(self._source.field, repeat)
            return
        for sentence, field in find_warnings(task, is_guessed=self._is_phase_guessed()):
            if (sentence, task.source) not in self._accepted:
                self._accepted.add((sentence, task.source))
                self._focus_error(self.query_one(f"#{field}"), sentence)
                return
        self._last_source = task.source
        self._last_recording = task.source, task.bare
        if (
            self.is_current and self._set_bare_aside()
        ):  # and the same key has not started it already
            screen = CollectScreen(task)
            self.app.push_screen(
                screen,
                lambda covered: self._return_from_recording(task, covered=bool(covered)),
            )

    def _describe_repeat(self, task: Task) -> str:
        """Return a sentence if the source has the pictures of the other phase; else an empty
        string. Blocks. A video is known by its name.
        """
        if task.setup[2].shape == "none":
            return ""
        is_repeated_video = (
            full_source(task.source).startswith("video:")
            and self._last_recording == (task.source, not task.bare)
            and count_pictures(task.session, bare=task.covered)
        )
        if is_repeated_video:
            return repeat_sentence(task.source, task.session, covered=task.covered)
        return describe_repeat(task.source, task.session, covered=task.covered)

    def _set_bare_aside(self) -> bool:
        """Set aside the pictures that are to be taken anew. Return False if that fails; the screen
        says why.
        """
        try:
            if self._phase.is_retake:
                set_bare_aside(self.session)
        except RefracalError as error:
            self._show_problem(str(error))
            return False
        return True

    async def _show_error(self, sentence: str) -> None:
        """Move to the first invalid field and show its error: its own, or that of the start if the
        start refuses values that are valid by themselves.
        """
        self._show_problem(sentence)
        fields = [field for field in self.query(Input) if not field.disabled]
        problems = {field: await self._find_problem(field) for field in fields}
        wrong = [field for field, problem in problems.items() if problem]
        for field in wrong:
            if isinstance(row := field.parent, Row):
                row.mark(wrong=True)
        if wrong:
            self._focus_error(wrong[0], problems[wrong[0]] or "")
            return
        if mentioned_field := next(
            (field for field in fields if field.name and f".{field.name} " in sentence), None
        ):
            self._focus_error(mentioned_field, sentence)

    def _focus_error(self, field: Widget, sentence: str) -> None:
        self._show_problem(sentence)
        if not field.has_focus:
            # the focus shows a field's error, but none for an empty field
            self._refusal = sentence
            field.focus()

    def _return_from_recording(self, task: Task, *, covered: bool) -> None:
        """Return from a recording: without the cover, perhaps to go on through it."""
        self._cover_is_on = covered
        if task.bare and not covered:
            self._phase.restore(bare=True)

    def _read(self) -> Task:
        source = self._source.field.value
        open_source(source, "source")
        if has_session_file(self.session):
            setup = read_setup(self.session / "session.yaml")
            board_of(self.session, None)
        else:
            setup = read_form(self._form.typed, self._like.setup[1] if self._like.setup else None)
        task = Task(self.session, source, setup, bare=self._phase.bare)
        if setup[2].shape == "none":
            return task
        check_source_folder(
            folder_source := select_pictures(task.source, covered=task.covered),
            covered=task.covered,
        )
        return replace(task, source=folder_source)

    def _show_problem(self, sentence: str) -> None:
        """Show a sentence; one about the form without the form's name, and in its words."""
        about_form = sentence.removeprefix(f"{FORM_NAME}: ")
        words = sentence if about_form == sentence else in_form_words(about_form)
        self.query_one("#problem", Static).update(words)

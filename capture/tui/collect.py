"""Collect: the screen with the live picture, the next instruction, the place for the board, and the
coverage.
"""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal
from textual.events import ScreenResume
from textual.message import Message

from calib.errors import harmless
from calib.io.images import list_images
from calib.session.session import MIN_FIT_VIEWS
from calib.verdict.verdict import Trust
from capture.coverage import Hint, SessionProgress
from capture.gate import GOOD_VIEW, HOLD_STILL, KNOWN_VIEW, MOVING, NO_BOARD
from capture.narrator import silence_sentence
from capture.other_board_search import OtherBoardSearch
from capture.recording_loop import Step, refusal_reason
from capture.sources.registry import is_recorded_source, is_rehearsal
from capture.tui.camera import Preview, RecordingRun, Task
from capture.tui.cells import CORNER_MARK, HINT_MARK, Mark
from capture.tui.corrected_fields import RECORD_ANEW, in_form_words, named_fields
from capture.tui.farewell import calibration_folder
from capture.tui.fit import FitScreen
from capture.tui.fit_requirements import find_missing, no_board_advice
from capture.tui.lens import ENOUGH_BARE_VIEWS
from capture.tui.live_undistortion import LiveUndistortion
from capture.tui.opening import OpeningScreen
from capture.tui.page import DOTS, HELP_AND_QUIT, Line, ToneRequested
from capture.tui.panel import Panel
from capture.tui.picture import Picture
from capture.tui.start_warnings import too_few_views_warning
from capture.tui.undistortion_page import UndistortionPage
from capture.tui.watching_page import WatchingPage

RETRY_S = 3.0  # s, after which a failed camera is tried again
TAKEN_S = 1.5  # s for which a kept view is announced, whatever comes next
FIT_FIRST = "Fit first: the result says whether more views are needed."
"""The remark on too few views through the cover, where no more come by themselves."""
BARE_VIEWS_HELP = (
    f"These are few for a lens, {ENOUGH_BARE_VIEWS} are enough: better first add other pictures.",
    "These are enough for the lens: go on.",
)
"""The remarks on the views below ENOUGH_BARE_VIEWS, and from there on."""
ENOUGH_NOTE = "There are enough views. More do no harm."
UNNEEDED_ADVICE = KNOWN_VIEW, NO_BOARD, HOLD_STILL, MOVING, GOOD_VIEW
"""The sentences on a frame that ask for one more view, which nobody needs once there are enough."""
ROOMY_WIDTH = 100  # columns
REASON_S = 6.0  # s for which the reason why a fit cannot start stays


class CollectScreen(WatchingPage, UndistortionPage):
    DEFAULT_CSS = """
    CollectScreen #top { height: 1fr; }
    CollectScreen Picture { width: 1fr; height: 1fr; }
    CollectScreen Panel { width: 31; }
    CollectScreen #verdict { height: auto; min-height: 2; max-height: 5; }
    CollectScreen #verdict { background: $primary; color: auto; }
    CollectScreen:nocolor #verdict { text-style: bold reverse; }
    CollectScreen #next { height: 2; padding: 0 1; }
    """
    BINDINGS: ClassVar = [
        Binding("space", "take", "Take now"),
        Binding("a", "automatic", "Auto"),
        Binding("n", "cover_on", "Cover on"),
        Binding("f", "fit", "Fit"),
        Binding("n", "none_yet", show=False),
        Binding("f", "not_yet", show=False),
        Binding("o", "again", "Reopen"),
        Binding("u", "straight", "Undistort"),
        Binding("u", "as_it_is", "As it is"),
        Binding("ctrl+o", "results", "Results", key_display="^o"),
        DOTS,
        Binding("escape", "back", "Set-up", key_display="esc"),
        Binding("s", "correct", show=False),
        *HELP_AND_QUIT,
    ]

    CORRECT_BOARD: ClassVar = "esc corrects the board"
    CORRECT_SIZE: ClassVar = "Press esc to correct it."

    class OtherBoardFound(Message):
        """The pictures show another board than the declared one."""

        def __init__(self, search: OtherBoardSearch, sentence: str) -> None:
            super().__init__()
            self.search = search
            self.sentence = sentence

    class FrameArrived(Message):
        """A frame has arrived."""

        def __init__(self, frame: Preview, undistortion: LiveUndistortion | None) -> None:
            super().__init__()
            self.frame = frame
            self.undistortion = undistortion
            self.preview = undistortion.preview(frame) if undistortion else frame

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self._frame: Preview | None = None
        self._preview: Preview | None = None
        """The last frame, undistorted if the person wants it so."""
        self._remarks: Sequence[str] = ()
        self._corners: NDArray[np.float64] | None = None
        self._hint: Hint | None = None
        self._message_until = 0.0
        self._refusal = ""
        """The reason why the last frame was refused."""
        self._enough = False
        self._ending = ""
        """The message at the end of the source."""
        self._end: WatchingPage.RecordingStopped | None = None
        """The end of the source, if all of its pictures were judged."""
        self._end_pictures: tuple[Path, ...] = ()
        """The pictures of the session at that end."""
        self._search = OtherBoardSearch(task.setup[0])
        self._other_board = ""
        """The sentence about the board that the pictures show in place of the declared one."""
        self._has_no_board = False
        """True if the source has ended and no picture showed the board."""
        self._warned = False
        """True once the screen has said that the views are too few: to press f again is to accept
        that.
        """
        self._judged_pictures = 0
        """The number of judged pictures of this run."""
        self._pictures_with_board = 0
        self._taken_pictures = 0
        self._known_views = 0
        """The number of photographs of this run whose views the session has already."""
        self._unused: list[str] = []
        """The photographs of this run that were not taken, each with the reason."""

    @property
    def _has_person(self) -> bool:
        """True if somebody holds the board: of pictures that were taken before nobody does."""
        source = self.plan.source
        return not is_recorded_source(source) or is_rehearsal(source)

    @property
    def early_actions(self) -> frozenset[str]:
        """A fit of few views can be tried, and is not what to do next."""
        fewest = ENOUGH_BARE_VIEWS if self.recording or self.plan.bare else MIN_FIT_VIEWS
        has_few = len(self.view_corners) < fewest and not self._enough
        early = {"fit", "cover_on"} if has_few else set()
        if self.MAPS and self.calibration() is not None:
            early.add("results" if self._taken_pictures else "fit")
        return frozenset(early)

    @property
    def finished_actions(self) -> frozenset[str]:
        """Once there are enough views, the next step takes the place of taking them by hand."""
        return frozenset({"take"} if self._enough and self.recording else ())

    @property
    def switches(self) -> Mapping[str, bool]:
        return {"automatic": self.shutter.automatic}

    def step(self) -> str:
        return "Without cover" if self.plan.bare else "Through cover"

    def body(self) -> ComposeResult:
        with Horizontal(id="top"):
            yield Picture()
            yield Panel(
                covered=self.MAPS and not self.plan.bare and self.plan.setup[2].shape != "none"
            )
        yield Line("The camera is being opened.", id="verdict", classes="banner", markup=False)
        yield Line(id="next", markup=False)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        del parameters
        has_calibration = not self.plan.bare and self.calibration() is not None
        offered = {
            "cover_on": self.plan.bare and bool(self.view_corners),
            "fit": not self.plan.bare,
            "again": self.recording is None,
            "take": self.recording is not None,
            "results": has_calibration and (self.recording is None or self._has_room),
            "straight": has_calibration and not self.is_undistorting,
            "as_it_is": has_calibration and self.is_undistorting,
        }
        return offered.get(action, True)

    @property
    def _has_room(self) -> bool:
        """True if the line of keys has room for the results beside the keys of a recording."""
        return bool(getattr(self.app, "on_phone", False)) or self.size.width >= ROOMY_WIDTH

    @on(ScreenResume)
    def _resume(self) -> None:
        """Start. A source that has ended is looked through anew only if the views have changed."""
        if self._end is None or self._end_pictures != self._pictures():
            self._start()
            return
        self._ending = self.ending_sentence(self._end)
        self._repeat_ending()
        self.refresh_bindings()
        self.show_hint(self._hint, self.query_one(Panel).progress)

    def _pictures(self) -> tuple[Path, ...]:
        folder = self.plan.folder
        return list_images(folder) if folder.is_dir() else ()

    def _start(self) -> None:
        picture = self.query_one(Picture)
        if (
            self.recording is None
            and self.is_current
            and self.start_recording(lambda: picture.phone)
        ):
            self._judged_pictures = self._pictures_with_board = self._taken_pictures = 0
            self._known_views = 0
            self._unused = []
            self._ending = self._other_board = ""
            self._has_no_board = False
            self._search = OtherBoardSearch(self.plan.setup[0])
            self._end = None
            self.refresh_bindings()

    def show(self, preview: Preview) -> None:
        self.post_message(self.FrameArrived(preview, self.undistortion))

    @on(FrameArrived)
    def _show_frame(self, message: FrameArrived) -> None:
        self._frame = message.frame
        # not a preview from before the undistortion changed
        if message.undistortion is self.undistortion:
            self._preview = message.preview
        self._draw()

    def show_silence(self, seconds: float) -> None:
        if self._is_message_over:
            self.say(silence_sentence(seconds))

    def recording_started(self) -> None:
        self.refresh_bindings()
        self._update_count()
        self.request_advice()

    def show_step(self, recording: RecordingRun, step: Step) -> None:
        self._judged_pictures += 1
        self._search.add(step)
        if self._search.is_full and not self.view_corners:
            self._search_other_board(self._search)
        self._pictures_with_board += step.detection.corners is not None
        self._corners = (
            step.detection.corners
            if step.detection.corners is not None
            else step.detection.partial_corners
        )
        if step.picture is not None:
            assert step.detection.corners is not None
            self.view_corners.append(step.detection.corners)
            self._taken_pictures += 1
            self.app.bell()
            self.post_message(ToneRequested("taken"))
            action = "Move the board to the next place." if self._has_person else step.frame.name
            if self._has_person and self._enough:
                action = ""
            if not self.is_making_maps:
                self.say(
                    f"TAKEN: view {len(self.view_corners)}. {harmless(action)}".strip(), TAKEN_S
                )
            self.refresh_bindings()
            self._update_count()
            self.request_advice()
        else:
            if step.frame.isolated:
                reason = step.decision.sentence.partition(":")[0].rstrip(".")
                self._unused.append(f"{step.frame.name} ({reason})")
                self._known_views += step.decision.sentence == KNOWN_VIEW
            if self._is_message_over:
                self.say(self._in_words(step.decision.sentence))
        if refusal_reason(step) != self._refusal:
            self._refusal = refusal_reason(step)
            if self._refusal and self._has_person and not self._enough:
                self.post_message(ToneRequested("refused"))
        if step.frame.isolated:  # a photograph stays on the screen until the next one
            self._draw()
        self._remarks = recording.remarks
        self._update_notes()

    def _in_words(self, sentence: str) -> str:
        """Return the sentence on a picture, without advice where nobody holds the board, and the
        next step where the advice is not needed any more.
        """
        if not self._has_person:
            return f"{sentence.partition(':')[0].rstrip('.')}."
        return self._enough_text() if self._enough and sentence in UNNEEDED_ADVICE else sentence

    def _enough_text(self) -> str:
        return f"ENOUGH: {self.next_step_text()}."

    def show_stop(self, message: WatchingPage.RecordingStopped) -> None:
        self._corners = None
        self.refresh_bindings()
        self.show_hint(self._hint, self.query_one(Panel).progress)
        if (
            message.exhausted
            and self._judged_pictures
            and not (self._pictures_with_board or self.view_corners)
        ):
            self._has_no_board = True
            self._search_other_board(self._search)
        if message.exhausted:
            self._end = message
            self._end_pictures = self._pictures()
        self._ending = self.ending_sentence(message)
        if not self.is_making_maps:
            self.say(self._ending)
        if message.retries:
            self.set_timer(RETRY_S, self._start)

    def ending_sentence(self, message: WatchingPage.RecordingStopped) -> str:
        if message.retries:
            return f"{message.sentence} It is tried again every 3 s."
        if self._other_board:
            return f"{in_form_words(self._other_board)} {self.CORRECT_SIZE}"
        if self._has_no_board:
            return no_board_advice(self.plan.setup[0], self._judged_pictures, self.CORRECT_BOARD)
        next_step_text = ""
        if self.plan.bare and self.view_corners:
            next_step_text = "n, then put the cover on"
        elif not self.plan.bare and len(self.view_corners) >= MIN_FIT_VIEWS:
            next_step_text = self._fit_keys()
        restart = f"o to {message.restart_text}, esc to name another source"
        if not next_step_text or not message.exhausted:
            next_step_text = ", ".join(filter(None, (next_step_text, restart)))
        elif self.plan.bare and len(self.view_corners) < ENOUGH_BARE_VIEWS:
            next_step_text = f"esc to name other pictures, or {next_step_text}"
        return f"{message.sentence} Press {next_step_text}.{self._unused_note()}"

    @work(thread=True, exclusive=True, group="other board", description="looks for another board")
    def _search_other_board(self, search: OtherBoardSearch) -> None:
        if sentence := search.describe():
            self.post_message(self.OtherBoardFound(search, sentence))

    @on(OtherBoardFound)
    def _show_other_board(self, message: OtherBoardFound) -> None:
        if message.search is not self._search or self._search.is_board_right:
            return  # of an earlier run, or of pictures before the right board
        self._other_board = message.sentence
        if self._end:
            self._ending = self.ending_sentence(self._end)
            self._repeat_ending()
        else:
            self.say(f"{in_form_words(self._other_board)} {self.CORRECT_SIZE}", REASON_S)

    @property
    def correction(self) -> tuple[str, str]:
        """The board, if no picture shows it."""
        if self._other_board:
            field = next(iter(named_fields(self._other_board)), "")
            return field, f"{in_form_words(self._other_board)} {RECORD_ANEW}"
        if self._has_no_board:
            where = "correct the board here, or name another source"
            return "", no_board_advice(self.plan.setup[0], self._judged_pictures, where)
        return "", ""

    def _unused_note(self) -> str:
        """Return a note on the photographs that were not taken; none where the session has the
        views of them all.
        """
        number = len(self._unused)
        if not number or self._known_views == self._judged_pictures:
            return ""
        suffix = f" and {number - 1} more" if number > 1 else ""
        return f" Not taken: {harmless(self._unused[0])}{suffix}."

    def show_advice(self, hint: Hint | None, progress: SessionProgress) -> None:
        self.query_one(Panel).progress = self.adapt_progress(progress)
        self.show_hint(hint, progress)
        self._update_notes()

    def show_hint(self, hint: Hint | None, progress: SessionProgress | None) -> None:
        """Show where to hold the board next, if there is to be a next view that somebody takes."""
        has_ended = not self.recording and (self.plan.bare or is_recorded_source(self.plan.source))
        is_enough = self.is_enough(progress)
        # the large line then says it
        is_announced = is_enough and bool(self.recording) and self._has_person
        if is_enough and not self._enough:
            self.post_message(ToneRequested("enough"))
            if is_announced and self._is_message_over:
                self.say(self._enough_text())
        self._enough = is_enough
        self._hint = None if has_ended or is_enough or not self._has_person else hint
        text = f"Next: {self._hint.instruction}." if self._hint else ""
        if is_enough:
            text = ENOUGH_NOTE if is_announced else f"{self._enough_text()} More views do no harm."
        elif self.MAPS and has_ended and self.view_corners:
            text = (
                BARE_VIEWS_HELP[len(self.view_corners) >= ENOUGH_BARE_VIEWS]
                if self.plan.bare
                else find_missing(self.plan.session)
                or (self.awaited if progress is None or self.is_improving else FIT_FIRST)
            )
        line = self.query_one("#next", Line)
        line.set_class(is_enough, Trust.TRUSTED.value)
        line.say(text)
        self._draw()

    def adapt_progress(self, progress: SessionProgress) -> SessionProgress:
        """Return the progress as the panel shows it."""
        return progress

    def is_enough(self, progress: SessionProgress | None) -> bool:
        return progress is not None and progress.is_enough

    def next_step_text(self) -> str:
        """Return the next step once the views are enough."""
        if self.plan.bare:
            return "press n, then put the cover on"
        return f"press {self._fit_keys()}"

    def _fit_keys(self) -> str:
        """Return the keys that lead on from the views through the cover."""
        if self.calibration() is None:
            return "f to fit"
        if not self.check_action("results", ()):
            return "f to fit anew"
        keys = "f to fit anew", "^o for the results"
        return ", ".join(keys if self._taken_pictures else keys[::-1])

    def _draw(self) -> None:
        marks = []
        if self._hint is not None:
            marks.append(Mark(HINT_MARK, self._hint.outline, closed=True, label=" HOLD IT HERE "))
        if self._corners is not None:
            marks.append(Mark(CORNER_MARK, self._corners))
        if self.undistortion:
            marks = self.undistortion.marks(marks, self.plan.setup[0])
        self.query_one(Picture).show(self._preview, marks)

    def _update_notes(self) -> None:
        notes = [f"Undistorted for {self.undistortion.depth:g} m."] if self.undistortion else []
        remarks = [self.guide_remark] if self.guide_remark else []
        self.query_one(Panel).say([*self._remarks, *remarks, *notes])

    def _update_count(self) -> None:
        self.query_one(Panel).count(len(self.view_corners), automatic=self.shutter.automatic)

    def say(self, sentence: str, for_s: float = 0.0) -> None:
        """Show a sentence. For `for_s` seconds, judged frames do not replace it; then the message
        about an ended source returns.
        """
        self._message_until = time.monotonic() + for_s
        self.query_one("#verdict", Line).say(sentence)
        if for_s:
            self.set_timer(for_s + 0.1, self._repeat_ending)

    @property
    def _is_message_over(self) -> bool:
        """True if the last message may be replaced: that maps are being made stays until they
        come.
        """
        return time.monotonic() >= self._message_until and not self.is_making_maps

    def _repeat_ending(self) -> None:
        """Show the message about an ended source once a later one is over."""
        if self._ending and not self.recording and self._is_message_over:
            self.say(self._ending)

    def action_take(self) -> None:
        self.shutter.press()
        self.say("The next picture that shows the board is taken.")

    def action_automatic(self) -> None:
        self.shutter.automatic = not self.shutter.automatic
        self._update_count()

    def action_again(self) -> None:
        self._start()

    def action_results(self) -> None:
        if folder := self.calibration():
            self.stop_recording()
            self.app.push_screen(OpeningScreen(self.plan.session, folder))

    def calibration(self) -> Path | None:
        return calibration_folder(self.plan.session)

    def picture_size(self) -> tuple[int, int] | None:
        return self._frame.size if self._frame else None

    def show_undistortion(self) -> None:
        if self._frame:
            self._preview = (
                self.undistortion.preview(self._frame) if self.undistortion else self._frame
            )
        self._draw()
        self._update_notes()

    def action_cover_on(self) -> None:
        self.stop_recording()
        self.dismiss(True)

    def action_correct(self) -> None:
        self.stop_recording()
        super().action_correct()

    def action_back(self) -> None:
        if self.correction[1]:
            self.action_correct()
            return
        self.stop_recording()
        self.dismiss(False)

    def action_fit(self) -> None:
        if lack := find_missing(self.plan.session):
            self.say(lack, REASON_S)
            return
        progress = self.query_one(Panel).progress
        if (
            self.recording and progress and not (self._enough or self._warned)
        ):  # where no more pictures come, f is the proposed key
            self._warned = True
            self.say(too_few_views_warning(progress), REASON_S)
            return
        self.stop_recording()
        self._taken_pictures = 0  # a fit has them all
        self.say("The camera is being opened.")
        self.app.push_screen(FitScreen(self.plan.session))

    def action_not_yet(self) -> None:
        """Explain why a fit is not offered."""
        self.say("The fit comes after the views through the cover.", REASON_S)

    def action_none_yet(self) -> None:
        """Explain why the cover is not to be put on."""
        sentence = (
            "The cover comes on once there are views without it: none is taken yet."
            if self.plan.bare
            else "n ends the views without the cover; f fits these."
        )
        self.say(sentence, REASON_S)

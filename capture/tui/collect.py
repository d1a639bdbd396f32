"""Collect: the live picture, what to do now, where to hold the board next, and what is covered."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal
from textual.events import ScreenResume
from textual.message import Message

from calib.session.camera import Camera
from capture.coverage import Hint, SessionProgress
from capture.narrator import silence_sentence
from capture.recording_loop import Step, refusal_reason
from capture.tui.camera import Preview, Task, Watch
from capture.tui.cells import FOUND, HINT, Mark
from capture.tui.farewell import fitted
from capture.tui.fit import FitScreen
from capture.tui.fit_requirements import lacking, lens_known, no_lens, none_found
from capture.tui.lens import ENOUGH
from capture.tui.live_undistortion import Straight
from capture.tui.opening import OpeningScreen
from capture.tui.page import DOTS, HELP_AND_QUIT, Line
from capture.tui.panel import Panel
from capture.tui.picture import Picture
from capture.tui.references import played
from capture.tui.start_warnings import too_few
from capture.tui.undistortion_page import StraighteningPage
from capture.tui.watching_page import WatchingPage

RETRY_S = 3.0  # after which a camera that failed is tried again
TAKEN_S = 1.5  # for which a view that was kept is said, whatever comes next
MORE = "More views would make it surer: they can come from another source."
MORE_BARE = (
    "More views would make the lens surer.",
    "Enough to go on. More views would make the lens surer.",
)
"""Before there are ENOUGH, and from there on."""
LACKING_S = 6.0  # for which it is said that a fit cannot begin


class CollectScreen(WatchingPage, StraighteningPage):
    DEFAULT_CSS = """
    CollectScreen #top { height: 1fr; }
    CollectScreen Picture { width: 1fr; height: 1fr; }
    CollectScreen Panel { width: 31; }
    CollectScreen #verdict { height: auto; min-height: 2; max-height: 5; background: $primary; color: auto; }
    CollectScreen:nocolor #verdict { text-style: bold reverse; }
    CollectScreen #next { height: 2; padding: 0 1; }
    """  # noqa: E501
    BINDINGS: ClassVar = [
        Binding("space", "take", "Take now"),
        Binding("a", "automatic", "Auto"),
        Binding("n", "cover_on", "Cover on"),
        Binding("f", "fit", "Fit"),
        Binding("n", "none_yet", show=False),
        Binding("f", "not_yet", show=False),
        Binding("o", "again", "Reopen"),
        Binding("u", "straight", "Undistort"),
        Binding("ctrl+o", "results", "Results", key_display="^o"),
        DOTS,
        Binding("escape", "back", "Set-up", key_display="esc"),
        *HELP_AND_QUIT,
    ]

    class Looked(Message):
        """A frame came."""

        def __init__(self, seen: Preview, straight: Straight | None) -> None:
            super().__init__()
            self.seen = seen
            self.straight = straight
            self.preview = straight.preview(seen) if straight else seen

    class Heard(Message):
        """Something that is worth a tone: taken, refused or enough."""

        def __init__(self, tone: str) -> None:
            super().__init__()
            self.tone = tone

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self._seen: Preview | None = None
        self._preview: Preview | None = None
        """The same, perhaps straightened."""
        self._remarks: Sequence[str] = ()
        self._found: NDArray[np.float64] | None = None
        self._hint: Hint | None = None
        self._said_until = 0.0
        self._refusal = ""
        """What the last frame was refused for."""
        self._enough = False
        self._ended = ""
        """What was said when the source ended."""
        self.wrong_board = ""
        """For the set-up, of a source that has ended and in which there was no board."""
        self._doubted = False
        """It was said that there are not enough views: to press f once more is to mean it."""
        self._looked = 0
        """Pictures of this stretch that were looked at, and in how many of them there was a board.
        """
        self._boards = 0

    def step(self) -> str:
        return "Without cover" if self.plan.bare else "Through cover"

    def body(self) -> ComposeResult:
        with Horizontal(id="top"):
            yield Picture()
            yield Panel(
                covered=self.MAPS and not self.plan.bare and self.plan.asked[2].shape != "none"
            )
        yield Line("The camera is being opened.", id="verdict", classes="banner", markup=False)
        yield Line(id="next", markup=False)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        del parameters
        offered = {
            "cover_on": self.plan.bare and bool(self.kept),
            "fit": not self.plan.bare and self._lens_known(),
            "again": self.watched is None,
            "take": self.watched is not None,
            "results": (
                not self.plan.bare and self.watched is None and self.calibration() is not None
            ),
            "straight": not self.plan.bare and self.calibration() is not None,
        }
        return offered.get(action, True)

    def _lens_known(self) -> bool:
        board, camera, cover = self.plan.asked
        if (size := self.picture_size()) and size != (camera.width, camera.height):
            camera = Camera(*size)  # a lens of other pictures is none of these
        return lens_known(self.plan.session, (board, camera, cover))

    @on(ScreenResume)
    def _begin(self) -> None:
        picture = self.query_one(Picture)
        if self.watched is None and self.is_current and self.begin(lambda: picture.phone):
            self._looked = self._boards = 0
            self._ended = self.wrong_board = ""
            self.refresh_bindings()

    def show(self, seen: Preview) -> None:
        self.post_message(self.Looked(seen, self.straight))

    @on(Looked)
    def _look(self, message: Looked) -> None:
        self._seen = message.seen
        if message.straight is self.straight:  # and not of the time before that changed
            self._preview = message.preview
        self._draw()

    def waits(self, seconds: float) -> None:
        if time.monotonic() > self._said_until:
            self.say(silence_sentence(seconds))

    def has_begun(self) -> None:
        self.refresh_bindings()
        self._count()
        self.think()

    def judged(self, watch: Watch, step: Step) -> None:
        self._looked += 1
        self._boards += step.detection.corners is not None
        self._found = (
            step.detection.corners
            if step.detection.corners is not None
            else step.detection.partial_corners
        )
        if step.picture is not None:
            assert step.detection.corners is not None
            self.kept.append(step.detection.corners)
            self.app.bell()
            self.post_message(self.Heard("taken"))
            self.say(f"TAKEN: view {len(self.kept)}. Move the board to the next place.", TAKEN_S)
            self.refresh_bindings()
            self._count()
            self.think()
        elif time.monotonic() > self._said_until:
            self.say(step.verdict.sentence)
        if refusal_reason(step) != self._refusal:
            self._refusal = refusal_reason(step)
            if self._refusal:
                self.post_message(self.Heard("refused"))
        if step.frame.isolated:  # it is shown for as long as the next one takes
            self._draw()
        self._remarks = watch.remarks
        self._note()

    def stopped(self, message: WatchingPage.Stopped) -> None:
        self._found = None
        self.refresh_bindings()
        self.point(self._hint, self.query_one(Panel).progress)
        if message.ended and self._looked and not (self._boards or self.kept):
            self.wrong_board = none_found(
                self.plan, self._looked, "correct the board here, or name another source"
            )
        self._ended = self.ending(message)
        self.say(self._ended)
        if message.again:
            self.set_timer(RETRY_S, self._begin)

    def ending(self, message: WatchingPage.Stopped) -> str:
        if message.again:
            return f"{message.sentence} It is tried again every 3 s."
        if self.wrong_board:
            return none_found(self.plan, self._looked)
        known = self.plan.bare or self._lens_known()
        if message.ended and not known:
            return f"{message.sentence} {no_lens(self.plan.session)} Press esc for that."
        onward = ""
        if self.kept and known:
            onward = (
                "n to go on through the cover, from another source, "
                if self.plan.bare
                else f"{self._fits()}, "
            )
        return f"{message.sentence} Press {onward}o to {message.anew}, esc for the set-up."

    def advised(self, hint: Hint | None, progress: SessionProgress) -> None:
        self.query_one(Panel).progress = self.told(progress)
        self.point(hint, progress)
        self._note()

    def point(self, hint: Hint | None, progress: SessionProgress | None) -> None:
        """Where to hold the board next, if there is to be a next view."""
        over = not self.watched and (self.plan.bare or played(self.plan.source))
        enough = self.enough(progress)
        if enough and not self._enough:
            self.post_message(self.Heard("enough"))
        self._enough = enough
        self._hint = None if over or enough else hint
        words = f"Next: {self._hint.words}." if self._hint else ""
        if enough:
            words = f"ENOUGH: {self.onward()}. More views do no harm."
        elif self.MAPS and over and self.kept:
            words = MORE_BARE[len(self.kept) >= ENOUGH] if self.plan.bare else MORE
        self.query_one("#next", Line).say(words)
        self._draw()

    def told(self, progress: SessionProgress) -> SessionProgress:
        """As it is shown beside the picture."""
        return progress

    def enough(self, progress: SessionProgress | None) -> bool:
        return progress is not None and progress.enough

    def onward(self) -> str:
        """What to do where there are enough views."""
        if self.plan.bare:
            return "press n, then put the cover on"
        return (
            f"press {self._fits()}" if self._lens_known() else "esc, for the lens is not known yet"
        )

    def _fits(self) -> str:
        """The keys that lead on from the views through the cover."""
        if self.calibration() is None:
            return "f to fit"
        return "f to fit anew" if self.watched else "f to fit anew, ^o for the results"

    def _draw(self) -> None:
        marks = []
        if self._hint is not None:
            marks.append(Mark(HINT, self._hint.outline, closed=True, label=" HOLD IT HERE "))
        if self._found is not None:
            marks.append(Mark(FOUND, self._found))
        if self.straight:
            marks = self.straight.marks(marks, self.plan.asked[0])
        self.query_one(Picture).show(self._preview, marks)

    def _note(self) -> None:
        straight = (
            [f"Undistorted for {self.straight.depth:g} m; u shows it as it is."]
            if self.straight
            else []
        )
        doubts = [self.doubt] if self.doubt else []
        self.query_one(Panel).say([*self._remarks, *doubts, *straight])

    def _count(self) -> None:
        self.query_one(Panel).count(len(self.kept), automatic=self.shutter.automatic)

    def say(self, sentence: str, for_s: float = 0.0) -> None:
        """`for_s`: what is judged meanwhile is not said."""
        self._said_until = time.monotonic() + for_s
        self.query_one("#verdict", Line).say(sentence)

    def _remark(self, sentence: str) -> None:
        """For some seconds; of a source that has ended, what was said of it comes back."""
        self.say(sentence, LACKING_S)
        self.set_timer(LACKING_S + 0.1, self._say_again)

    def _say_again(self) -> None:
        if self._ended and not self.watched and time.monotonic() >= self._said_until:
            self.say(self._ended)

    def action_take(self) -> None:
        self.shutter.press()
        self.say("The next picture in which the board is found is taken.")

    def action_automatic(self) -> None:
        self.shutter.automatic = not self.shutter.automatic
        self._count()

    def action_again(self) -> None:
        self._begin()

    def action_results(self) -> None:
        if folder := self.calibration():
            self.rest()
            self.app.push_screen(OpeningScreen(self.plan.session, folder))

    def calibration(self) -> Path | None:
        return fitted(self.plan.session)

    def picture_size(self) -> tuple[int, int] | None:
        return self._seen.size if self._seen else None

    def show_straight(self) -> None:
        if self._seen:
            self._preview = self.straight.preview(self._seen) if self.straight else self._seen
        self._draw()
        self._note()

    def action_cover_on(self) -> None:
        self.rest()
        self.dismiss(True)

    def action_back(self) -> None:
        self.rest()
        self.dismiss(False)

    def action_fit(self) -> None:
        if lack := lacking(self.plan.session):
            self._remark(lack)
            return
        progress = self.query_one(Panel).progress
        if (
            self.watched and progress and not (self._enough or self._doubted)
        ):  # where no more pictures come, f is what is proposed
            self._doubted = True
            self._remark(too_few(progress))
            return
        self.rest()
        self.say("The camera is being opened.")
        self.app.push_screen(FitScreen(self.plan.session))

    def action_not_yet(self) -> None:
        """Where a fit is not offered."""
        self._remark(
            "The fit comes after the views through the cover."
            if self.plan.bare
            else no_lens(self.plan.session)
        )

    def action_none_yet(self) -> None:
        """Where the cover is not to be put on."""
        said = (
            "The cover comes on once there are views without it: none is taken yet."
            if self.plan.bare
            else "n ends the views without the cover; f fits these."
        )
        self._remark(said)

"""The screen of a rig: the live pictures of its cameras side by side, the next instruction, and the
place for the board in each picture.
"""

import time
from collections.abc import Sequence
from typing import ClassVar

from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.events import ScreenResume
from textual.message import Message

from calib.errors import RefracalError, harmless
from capture.errors import CaptureError
from capture.narrator import silence_sentence
from capture.recording_loop import ShutterButton
from capture.rig.moment_gate import Corners
from capture.rig.rig_guide import Advice, RigGuide, RigHint
from capture.rig.rig_loop import RigStep
from capture.rig.rig_setup import RigSetup
from capture.tui.camera import Preview
from capture.tui.cells import CORNER_MARK, HINT_MARK, Mark
from capture.tui.collect import RETRY_S, TAKEN_S
from capture.tui.page import DOTS, HELP_AND_QUIT, Line, Page, ToneRequested
from capture.tui.picture import Picture
from capture.tui.rig_run import RigRun


class RigScreen(Page):
    DEFAULT_CSS = """
    RigScreen #pictures { height: 1fr; }
    RigScreen #pictures Vertical { width: 1fr; padding: 0 1 0 0; }
    RigScreen .name { height: 1; padding: 0 1; text-style: bold; }
    RigScreen Picture { width: 1fr; height: 1fr; }
    RigScreen #verdict { height: auto; min-height: 2; max-height: 4; }
    RigScreen #verdict { background: $primary; color: auto; }
    RigScreen:nocolor #verdict { text-style: bold reverse; }
    RigScreen #next { height: 2; padding: 0 1; }
    RigScreen #progress { height: 2; padding: 0 1; }
    RigScreen #notes { height: 2; padding: 0 1; color: $text-muted; }
    """
    BINDINGS: ClassVar = [
        Binding("space", "take", "Take now"),
        Binding("a", "automatic", "Auto"),
        Binding("o", "again", "Reopen"),
        DOTS,
        *HELP_AND_QUIT,
    ]

    class FrameArrived(Message):
        """A frame of one camera has arrived."""

        def __init__(self, name: str, preview: Preview) -> None:
            super().__init__()
            self.camera = name
            self.preview = preview

    class SourceSilent(Message):
        """No frame of a camera has come for some time."""

        def __init__(self, name: str, seconds: float) -> None:
            super().__init__()
            self.camera = name
            self.seconds = seconds

    class RecordingStarted(Message):
        """The cameras run, and the rig's views are known."""

        def __init__(self, run: RigRun, views: Sequence[Corners]) -> None:
            super().__init__()
            self.run = run
            self.views = views

    class MomentJudged(Message):
        """A moment was judged, and perhaps kept."""

        def __init__(self, run: RigRun, step: RigStep) -> None:
            super().__init__()
            self.run = run
            self.step = step

    class RecordingStopped(Message):
        """No more frames come."""

        def __init__(self, run: RigRun, sentence: str, *, retries: bool) -> None:
            """`retries` is True if the camera may return by itself."""
            super().__init__()
            self.run = run
            self.sentence = sentence
            self.retries = retries

    class AdviceReady(Message):
        """The guide has advice about this number of views."""

        def __init__(self, count: int, advice: Advice) -> None:
            super().__init__()
            self.count = count
            self.advice = advice

    def __init__(self, setup: RigSetup) -> None:
        super().__init__()
        self.setup = setup
        self.views: list[Corners] = []
        """The corners of the rig's views."""
        self._shutter = ShutterButton()
        self._recording: RigRun | None = None
        self._hint: RigHint | None = None
        self._previews: dict[str, Preview] = {}
        self._detected: Corners = {}
        self._message_until = 0.0
        self._enough = False
        self._guide: RigGuide | None = None
        self._advised = -1  # views
        self._advising = False

    @property
    def shared_count(self) -> int:
        """The number of views that several cameras share."""
        return sum(len(view) > 1 for view in self.views)

    @property
    def _next_command(self) -> str:
        return harmless(f"Then: {self.setup.rig.fit_command}.")

    def step(self) -> str:
        return "Rig"

    def _step_line(self) -> str:
        return f" [RIG: {' and '.join(self.setup.rig.sessions)}]"

    def body(self) -> ComposeResult:
        with Horizontal(id="pictures"):
            for name in self.setup.rig.sessions:
                with Vertical():
                    yield Line(name, classes="name", markup=False)
                    yield Picture(id=f"picture-{name}", name=name)
        yield Line("The cameras are being opened.", id="verdict", classes="banner", markup=False)
        yield Line(id="next", markup=False)
        yield Line(id="progress", markup=False)
        yield Line(id="notes", markup=False)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        del parameters
        offered = {"again": self._recording is None, "take": self._recording is not None}
        return offered.get(action, True)

    @on(ScreenResume)
    def _start(self) -> None:
        if self._recording is not None or not self.is_current:
            return
        picture = self.query(Picture).first()
        try:
            self._recording = RigRun(
                self.setup,
                self._shutter,
                lambda name, preview: self.post_message(self.FrameArrived(name, preview)),
                lambda name, seconds: self.post_message(self.SourceSilent(name, seconds)),
                sharp=lambda: picture.phone,
            )
        except RefracalError as error:
            self.say(str(error))
            return
        self._shutter.take_press()  # discard a press that was meant for a run that has ended
        self._record(self._recording)
        self.refresh_bindings()

    @work(thread=True, group="camera", description="records")
    def _record(self, run: RigRun) -> None:
        try:
            for step in run.run(lambda views: self.post_message(self.RecordingStarted(run, views))):
                self.post_message(self.MomentJudged(run, step))
            sentence = "The sources have no more pictures."
            self.post_message(self.RecordingStopped(run, sentence, retries=False))
        except RefracalError as error:
            retries = isinstance(error, CaptureError)
            self.post_message(self.RecordingStopped(run, str(error), retries=retries))

    @work(thread=True, group="advice", description="advises")
    def _advise(self, guide: RigGuide, views: Sequence[Corners]) -> None:
        self.post_message(self.AdviceReady(len(views), guide.advise(views)))

    @on(FrameArrived)
    def _show_frame(self, message: FrameArrived) -> None:
        self._previews[message.camera] = message.preview
        self._draw(message.camera)

    @on(SourceSilent)
    def _show_silence(self, message: SourceSilent) -> None:
        if self._recording and time.monotonic() > self._message_until:
            self.say(f"{message.camera}: {silence_sentence(message.seconds)}")

    @on(RecordingStarted)
    def _show_start(self, message: RecordingStarted) -> None:
        if message.run is self._recording:
            self.views = list(message.views)
            self._show_count()

    @on(MomentJudged)
    def _show_step(self, message: MomentJudged) -> None:
        if message.run is not self._recording:
            return
        step = message.step
        self._detected = {
            name: corners
            for name, found in step.detections.items()
            if (corners := found.corners if found.corners is not None else found.partial_corners)
            is not None
        }
        if step.pictures:
            view = {
                name: corners
                for name in step.pictures
                if (corners := step.detections[name].corners) is not None
            }
            self.views.append(view)
            self.app.bell()
            self.post_message(ToneRequested("taken"))
            alone = f", for {next(iter(view))} alone" if len(view) == 1 else ""
            self.say(
                f"TAKEN: view {len(self.views)}{alone}. Move the board to the next place.", TAKEN_S
            )
            self._show_count()
        elif time.monotonic() > self._message_until:
            self.say(step.decision.sentence)
        self._guide = message.run.guide
        self._request_advice()
        self.query_one("#notes", Line).say("\n".join(list(message.run.remarks)[-2:]))

    @on(RecordingStopped)
    def _show_stop(self, message: RecordingStopped) -> None:
        if message.run is not self._recording:
            return
        self._recording = None
        self._detected = {}
        self.refresh_bindings()
        if message.retries:
            self.say(f"{message.sentence} It is tried again every 3 s.")
            self.set_timer(RETRY_S, self._start)
        else:
            self.say(f"{message.sentence} Press o to try again, q to end.")
            if self.views:
                self.query_one("#notes", Line).say(self._next_command)

    @on(AdviceReady)
    def _show_advice(self, message: AdviceReady) -> None:
        self._advising = False
        self._request_advice()
        if message.count != len(self.views):
            return
        self._hint, progress = message.advice
        self.query_one("#progress", Line).say(progress.sentence)
        text = f"Next, {self._hint.instruction}." if self._hint else ""
        if progress.is_enough:
            text = f"ENOUGH: q ends. {self._next_command} More views do no harm."
            if not self._enough:
                self.post_message(ToneRequested("enough"))
        self._enough = progress.is_enough
        self.query_one("#next", Line).say(text)
        for name in self.setup.rig.sessions:
            self._draw(name)

    def _request_advice(self) -> None:
        """Ask the guide about the present views, one request after the other."""
        if self._guide and not self._advising and self._advised != len(self.views):
            self._advised, self._advising = len(self.views), True
            self._advise(self._guide, tuple(self.views))

    def _show_count(self) -> None:
        alone = len(self.views) - self.shared_count
        automatic = "ON" if self._shutter.automatic else "OFF"
        counts = {
            name: sum(name in view for view in self.views) for name in self.setup.rig.sessions
        }
        labels = list(self.query(".name").results(Line))
        for line, (name, count) in zip(labels, counts.items(), strict=True):
            line.say(f"{name}: {count} view{'s' * (count != 1)}")
        self.query_one("#steps", Line).say(
            f"{self._step_line()} › {self.shared_count} shared, {alone} alone, auto {automatic}"
        )

    def _draw(self, name: str) -> None:
        marks = []
        if self._hint and name in self._hint.outlines:
            outline = self._hint.outlines[name]
            marks.append(Mark(HINT_MARK, outline, closed=True, label=" HOLD IT HERE "))
        if name in self._detected:
            marks.append(Mark(CORNER_MARK, self._detected[name]))
        self.query_one(f"#picture-{name}", Picture).show(self._previews.get(name), marks)

    def say(self, sentence: str, for_s: float = 0.0) -> None:
        """Show a sentence. For `for_s` seconds, judged moments do not replace it."""
        self._message_until = time.monotonic() + for_s
        self.query_one("#verdict", Line).say(sentence)

    def action_take(self) -> None:
        self._shutter.press()
        self.say("The next moment at which a camera sees the board is taken.")

    def action_automatic(self) -> None:
        self._shutter.automatic = not self._shutter.automatic
        self._show_count()

    def action_again(self) -> None:
        self._start()

    def on_unmount(self) -> None:
        if self._recording:
            self._recording.close()
            self._recording = None

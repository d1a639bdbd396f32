"""A page that watches a source of pictures in a thread, and gets the result of every frame."""

from abc import abstractmethod
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from textual import on, work
from textual.message import Message

from calib.errors import RefracalError
from capture.errors import CaptureError
from capture.recording_loop import ShutterButton, Step
from capture.tui.camera import Preview, RecordingRun, Task
from capture.tui.guided_page import GuidedPage


class WatchingPage(GuidedPage):
    class SourceSilent(Message):
        """No frame has come for some time."""

        def __init__(self, seconds: float) -> None:
            super().__init__()
            self.seconds = seconds

    class RecordingStarted(Message):
        """The camera runs, and the session's views are known."""

        def __init__(
            self, recording: RecordingRun, view_corners: Sequence[NDArray[np.float64]]
        ) -> None:
            super().__init__()
            self.recording = recording
            self.view_corners = view_corners

    class FrameJudged(Message):
        """A frame was judged, and perhaps kept."""

        def __init__(self, recording: RecordingRun, step: Step) -> None:
            super().__init__()
            self.recording = recording
            self.step = step

    class RecordingStopped(Message):
        """No more frames come."""

        def __init__(
            self, recording: RecordingRun, sentence: str, *, retries: bool, exhausted: bool = False
        ) -> None:
            """`retries` is True if the source may return by itself.

            `ended` is True if every picture of the source was judged.
            """
            super().__init__()
            self.recording = recording
            self.sentence = sentence
            self.retries = retries
            self.exhausted = exhausted

        @property
        def restart_text(self) -> str:
            """The effect of starting once more."""
            return "look through it again" if self.exhausted else "try again"

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self.shutter = ShutterButton()
        self.recording: RecordingRun | None = None
        """The recording, as long as frames come from its source."""

    @abstractmethod
    def show(self, preview: Preview) -> None:
        """Show a frame; called in the camera's thread."""

    @abstractmethod
    def say(self, sentence: str, for_s: float = 0.0) -> None: ...

    @abstractmethod
    def show_silence(self, seconds: float) -> None:
        """Show that no frame has come for this time, in s."""

    @abstractmethod
    def recording_started(self) -> None:
        """Frames come, and `view_corners` has the session's views."""

    @abstractmethod
    def show_step(self, recording: RecordingRun, step: Step) -> None:
        """Show a judged frame, which may have been kept."""

    @abstractmethod
    def show_stop(self, message: RecordingStopped) -> None:
        """No more frames come, and `recording` is None."""

    def start_recording(self, sharp: Callable[[], bool]) -> bool:
        """Open the source; return True if frames can be expected. An error is shown.

        Args:
            sharp: says, in the camera's thread, whether frames are shown larger than in a terminal.
        """
        try:
            self.recording = RecordingRun(
                self.plan,
                self.shutter,
                self.show,
                lambda seconds: self.post_message(self.SourceSilent(seconds)),
                sharp,
            )
        except RefracalError as error:
            self.say(str(error))
            return False
        self.shutter.take_press()  # discard a press that was meant for a source that has ended
        self._run(self.recording)
        return True

    @work(thread=True, group="camera", description="records")
    def _run(self, recording: RecordingRun) -> None:
        try:
            for step in recording.run(
                lambda view_corners: self.post_message(
                    self.RecordingStarted(recording, view_corners)
                )
            ):
                self.post_message(self.FrameJudged(recording, step))
            self.post_message(
                self.RecordingStopped(
                    recording, "There are no more pictures.", retries=False, exhausted=True
                )
            )
        except RefracalError as error:
            self.post_message(
                self.RecordingStopped(
                    recording, str(error), retries=isinstance(error, CaptureError)
                )
            )

    @on(SourceSilent)
    def _handle_silence(self, message: SourceSilent) -> None:
        if self.recording is not None:
            self.show_silence(message.seconds)

    @on(RecordingStarted)
    def _handle_start(self, message: RecordingStarted) -> None:
        if message.recording is self.recording:
            self.view_corners = list(message.view_corners)
            self.recording_started()

    @on(FrameJudged)
    def _handle_step(self, message: FrameJudged) -> None:
        if message.recording is self.recording:
            self.show_step(message.recording, message.step)

    @on(RecordingStopped)
    def _handle_stop(self, message: RecordingStopped) -> None:
        if message.recording is self.recording:
            self.recording = None
            self.show_stop(message)

    def stop_recording(self) -> None:
        """Close the camera."""
        if self.recording:
            self.recording.close()
            self.recording = None

    def on_unmount(self) -> None:
        self.stop_recording()

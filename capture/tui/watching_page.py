"""A page that watches a source of pictures in a thread of its own, and hears what came of every
frame.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from textual import on, work
from textual.message import Message

from calib.errors import RefracalError
from capture.errors import CaptureError
from capture.recording_loop import ShutterButton, Step
from capture.tui.camera import Preview, Task, Watch
from capture.tui.guided_page import GuidedPage


class WatchingPage(GuidedPage):
    class Waited(Message):
        """No frame came for some time."""

        def __init__(self, seconds: float) -> None:
            super().__init__()
            self.seconds = seconds

    class Begun(Message):
        """The camera runs, and the views that the session has are known."""

        def __init__(self, watch: Watch, kept: Sequence[NDArray[np.float64]]) -> None:
            super().__init__()
            self.watch = watch
            self.kept = kept

    class Judged(Message):
        """A frame was looked at, and perhaps kept."""

        def __init__(self, watch: Watch, step: Step) -> None:
            super().__init__()
            self.watch = watch
            self.step = step

    class Stopped(Message):
        """No more frames come."""

        def __init__(
            self, watch: Watch, sentence: str, *, again: bool, ended: bool = False
        ) -> None:
            """`again`: it may come back by itself.

            `ended`: every picture of the source was looked at.
            """
            super().__init__()
            self.watch = watch
            self.sentence = sentence
            self.again = again
            self.ended = ended

        @property
        def anew(self) -> str:
            """What beginning once more comes to."""
            return "look through it again" if self.ended else "try again"

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self.shutter = ShutterButton()
        self.watched: Watch | None = None
        """The source, as long as frames come from it."""

    @abstractmethod
    def show(self, seen: Preview) -> None:
        """A frame came; in the camera's thread."""

    @abstractmethod
    def say(self, sentence: str, for_s: float = 0.0) -> None: ...

    @abstractmethod
    def waits(self, seconds: float) -> None:
        """No frame came for so long."""

    @abstractmethod
    def has_begun(self) -> None:
        """Frames come, and `kept` has the views that there are."""

    @abstractmethod
    def judged(self, watch: Watch, step: Step) -> None:
        """A frame was looked at, and perhaps kept."""

    @abstractmethod
    def stopped(self, message: Stopped) -> None:
        """No more frames come, and `watched` is None."""

    def begin(self, sharp: Callable[[], bool]) -> bool:
        """Open the source; whether frames can be expected now. What stands against it is said.

        Args:
            sharp: whether frames are shown larger than in a terminal; asked in the camera's thread.
        """
        try:
            self.watched = Watch(
                self.plan,
                self.shutter,
                self.show,
                lambda seconds: self.post_message(self.Waited(seconds)),
                sharp,
            )
        except RefracalError as error:
            self.say(str(error))
            return False
        self.shutter.take_press()  # of a source that has ended
        self._run(self.watched)
        return True

    @work(thread=True, group="camera", description="records")
    def _run(self, watch: Watch) -> None:
        try:
            for step in watch.run(lambda kept: self.post_message(self.Begun(watch, kept))):
                self.post_message(self.Judged(watch, step))
            self.post_message(
                self.Stopped(watch, "The source has no more pictures.", again=False, ended=True)
            )
        except RefracalError as error:
            self.post_message(
                self.Stopped(watch, str(error), again=isinstance(error, CaptureError))
            )

    @on(Waited)
    def _waited(self, message: Waited) -> None:
        if self.watched is not None:
            self.waits(message.seconds)

    @on(Begun)
    def _begun(self, message: Begun) -> None:
        if message.watch is self.watched:
            self.kept = list(message.kept)
            self.has_begun()

    @on(Judged)
    def _judged(self, message: Judged) -> None:
        if message.watch is self.watched:
            self.judged(message.watch, message.step)

    @on(Stopped)
    def _stopped(self, message: Stopped) -> None:
        if message.watch is self.watched:
            self.watched = None
            self.stopped(message)

    def rest(self) -> None:
        """Close the camera."""
        if self.watched:
            self.watched.close()
            self.watched = None

    def on_unmount(self) -> None:
        self.rest()

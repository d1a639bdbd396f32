"""A stream takes the newest frame of a source, straightens it, and sends it to every target."""

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from capture.errors import CaptureError
from capture.frames import FrameSource
from capture.reader import Reader
from capture.streaming.statistics import StreamStatistics
from capture.streaming.target import ReaderGoneError, StreamTarget, TargetError

RETRY_S = 1.0
"""The time in s between two attempts to open a camera that has gone."""

Ending = Literal["source", "interrupted", "reader"]
"""The cause of a stream's end: its source has no more frames, the person interrupted it, or the
reader of a pipe has gone.
"""


class PictureMaker(Protocol):
    """The interface of `Straightener`, which this module does not import because it loads torch."""

    @property
    def depth_images(self) -> int | None:
        """The number of depth images that were read; None for a stream at one depth."""
        ...

    def straighten(self, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the picture of a frame; both are (H, W) grey or (H, W, 3) BGR."""
        ...


class StreamListener(Protocol):
    """A receiver of the messages that a person should see."""

    def tell(self, sentence: str) -> None:
        """Show a sentence, from any thread."""
        ...

    def report_silence(self, seconds: float) -> None:
        """Show that a camera that is there has sent nothing for this time, in s."""
        ...

    def report_counts(self, statistics: StreamStatistics) -> None:
        """Get the counts after each frame."""
        ...


class Stream:
    def __init__(
        self,
        open_source: Callable[[], FrameSource],
        straightener: PictureMaker,
        targets: Sequence[StreamTarget],
        listener: StreamListener,
        *,
        paced: bool = False,
    ) -> None:
        """
        Args:
            open_source: returns the source, and again after its camera has gone.
            straightener: the maker of the straight pictures.
            targets: the receivers of each picture, in this order. The caller may add more before
                `run`.
            listener: the receiver of the messages for a person.
            paced: true if a recorded video is shown to a person, at the rate at which it was taken;
                otherwise its frames come as fast as they can be read.
        """
        self.statistics = StreamStatistics()
        self.stop = threading.Event()
        """Set by `close`. Targets that may wait look at it."""
        self._open_source = open_source
        self._straightener = straightener
        self._paced = paced
        self._targets = targets
        self.listener = listener
        self._reader: Reader | None = None
        self._are_open = False  # the targets
        self._gone_since: float | None = None  # s of the monotonic clock; None: the camera is there

    def run(self) -> Ending:
        """Stream until the source ends, `close` is called, or the reader of a pipe has gone.

        A camera that goes away after its first frame is waited for.

        Raises:
            CaptureError: the camera gave no frame at all, or a target failed.
            InputError: the frames do not have the size of the calibration.
        """
        with ExitStack() as stack:
            while not self.stop.is_set():
                try:
                    self._forward_frames(stack)
                    break
                except ReaderGoneError:
                    return "reader"
                except TargetError:
                    raise
                except CaptureError as error:
                    if not self.statistics.frames:
                        raise
                    self._wait_after(error)
        return "interrupted" if self.stop.is_set() else "source"

    def close(self) -> None:
        """End the stream, from any thread or a signal handler."""
        self.stop.set()
        if self._reader:
            self._reader.close()

    def _forward_frames(self, stack: ExitStack) -> None:
        """Forward frames until the source ends. The targets open after the first source, on the
        stack, so no address is printed for a camera that is missing.
        """
        source = self._open_source()
        skipped = self.statistics.skipped
        losses = self.statistics.camera_losses
        with Reader(source, self.listener.report_silence) as reader:
            self._reader = reader
            if not self._are_open:
                self._are_open = True
                for target in self._targets:
                    stack.enter_context(target)
            if self._gone_since is not None:
                elapsed_s = time.monotonic() - self._gone_since
                self.listener.tell(f"The camera is back, after {elapsed_s:.0f} s.")
                self._gone_since = None
            for remark in source.remarks if not self.statistics.frames else ():
                self.listener.tell(remark)
            for frame in reader:
                if self.stop.is_set():
                    return
                if self._paced:
                    self.stop.wait(max(0.0, frame.time_s - time.monotonic()))
                picture = self._straightener.straighten(frame.pixels)
                for target in self._targets:
                    target.show(picture)
                self.statistics.skipped = skipped + reader.skipped
                self.statistics.camera_losses = losses + reader.lost
                self.statistics.depth_images = self._straightener.depth_images
                self.statistics.count_frame(reader.arrival_s)
                self.listener.report_counts(self.statistics)

    def _wait_after(self, error: CaptureError) -> None:
        """Say once that the camera has gone, and wait before the next attempt."""
        if self._gone_since is None:
            self._gone_since = time.monotonic()
            self.statistics.interruptions += 1
            event = str(error).partition(": ")[0]
            self.listener.tell(f"{event}: the stream goes on when the camera is back.")
        self.stop.wait(RETRY_S)

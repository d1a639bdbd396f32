"""The newest frame of a source, however slow its user is.

A thread takes every frame that the camera sends and keeps the last one. So slow work never delays
the camera and never gets an old picture: it gets the frame that was the newest when it asked. A
source that is not live waits to be read instead.
"""

import threading
import time
from collections.abc import Callable, Iterator
from types import TracebackType

from capture.frames import Frame, FrameSource

# s, after which a thread that does not end is abandoned: longer than any source waits for its
# device
JOIN_TIMEOUT_S = 5.0
SILENT_S = 1.0  # s without a frame of a live source: from here on, whoever waits for it is told
OPENING_S = 3.0  # s that a camera may take to send its first frame without a message


class Reader:
    """A reader that opens a source by `with` and reads it by `for`; an error in its thread is
    raised in the `for`.
    """

    def __init__(
        self, source: FrameSource, on_silence: Callable[[float], object] = lambda _: None
    ) -> None:
        """`on_silence` is called once a second with the seconds for which a live source has sent
        nothing. The caller is the thread that iterates, or a separate one while the source opens.
        """
        self.source = source
        self._on_silence = on_silence
        self.skipped = 0
        """The number of frames that came while nobody was ready for them."""
        self.lost = 0
        """The number of frames that never came: the gaps in the driver's counter, except between
        photographs.
        """
        self.arrival_s = 0.0
        """The time of the monotonic clock, s, at which the frame came that the iteration gave last.
        """
        self._changed = threading.Condition()
        self._newest: Frame | None = None
        self._newest_s = 0.0
        self._ended = False
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)

    def __enter__(self) -> "Reader":
        opening = threading.Timer(OPENING_S, self._on_silence, (OPENING_S,))
        opening.daemon = True
        opening.start()
        try:
            self.source.__enter__()
        finally:
            opening.cancel()
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
        self._thread.join(JOIN_TIMEOUT_S)
        if (
            not self._thread.is_alive()
        ):  # a device that hangs in the driver stays open until the process ends
            self.source.__exit__(kind, value, trace)

    def __iter__(self) -> Iterator[Frame]:
        last_s = time.monotonic()
        while True:
            with self._changed:
                arrived = self._changed.wait_for(
                    lambda: self._newest or self._ended, SILENT_S if self.source.live else None
                )
                frame, self._newest = self._newest, None
                self.arrival_s = self._newest_s
                self._changed.notify_all()
            if frame is not None:
                yield frame
                last_s = time.monotonic()
            elif not arrived:
                self._on_silence(time.monotonic() - last_s)
            elif self._error:
                raise self._error
            else:
                return

    def close(self) -> None:
        """End the iteration, from any thread or a signal handler."""
        with self._changed:
            self._ended, self._newest = True, None
            self._changed.notify_all()
        self.source.close()

    def _run(self) -> None:
        try:
            self._read()
        except BaseException as error:
            self._error = error
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _read(self) -> None:
        expected = None
        for frame in self.source:
            with self._changed:
                if not self.source.live:
                    self._changed.wait_for(lambda: self._newest is None or self._ended)
                if self._ended:
                    return
                self.skipped += self._newest is not None
                if expected is not None and not frame.isolated:
                    self.lost += max(frame.sequence - expected, 0)
                expected = frame.sequence + 1
                self._newest = frame
                self._newest_s = time.monotonic()
                self._changed.notify_all()

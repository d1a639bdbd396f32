"""The newest frame of a source, however slow its user is.

A thread of its own takes every frame that the camera sends and keeps the last one, so slow work
never delays the camera and is never
given an old picture: what it gets was the newest when it asked. A source that is not live waits to
    be read instead.
"""

import threading
import time
from collections.abc import Callable, Iterator
from types import TracebackType

from capture.frames import Frame, FrameSource

# s, until a thread that does not end is left behind: longer than any source waits for its device
PATIENCE = 5.0
SILENT_S = 1.0  # without a frame of a live source: from here on, whoever waits for it is told so
OPENING_S = 3.0  # for which a camera may take to send its first frame, with nothing said


class Reader:
    """Opens a source by `with` and reads it by `for`; what goes wrong in the thread is raised
    there.
    """

    def __init__(
        self, source: FrameSource, waits: Callable[[float], object] = lambda _: None
    ) -> None:
        """`waits` is called with the seconds for which a live source has sent nothing, once a
        second; from the thread that iterates, or one of its own while the source is being opened.
        """
        self.source = source
        self._waits = waits
        self.unseen = 0
        """Frames that came while nobody was ready for them."""
        self.lost = 0
        """Frames that never came: gaps in the driver's counter, but for those between photographs.
        """
        self._changed = threading.Condition()
        self._newest: Frame | None = None
        self._ended = False
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)

    def __enter__(self) -> "Reader":
        opening = threading.Timer(OPENING_S, self._waits, (OPENING_S,))
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
        self._thread.join(PATIENCE)
        if (
            not self._thread.is_alive()
        ):  # a device that hangs in the driver is left to the end of the process
            self.source.__exit__(kind, value, trace)

    def __iter__(self) -> Iterator[Frame]:
        since = time.monotonic()
        while True:
            with self._changed:
                come = self._changed.wait_for(
                    lambda: self._newest or self._ended, SILENT_S if self.source.live else None
                )
                frame, self._newest = self._newest, None
                self._changed.notify_all()
            if frame is not None:
                yield frame
                since = time.monotonic()
            elif not come:
                self._waits(time.monotonic() - since)
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
                self.unseen += self._newest is not None
                if expected is not None and not frame.alone:
                    self.lost += max(frame.sequence - expected, 0)
                expected = frame.sequence + 1
                self._newest = frame
                self._changed.notify_all()

"""The newest frame of a source, however slow its user is.

A thread of its own takes every frame that the camera sends and keeps the last one, so slow work never delays the camera and is never
given an old picture: what it gets was the newest when it asked. A source that is not live waits to be read instead.
"""

import threading
from collections.abc import Iterator
from types import TracebackType

from capture.frames import Frame, FrameSource

PATIENCE = 5.0  # s, until a thread that does not end is left behind: longer than any source waits for its device


class Reader:
    """Opens a source by `with` and reads it by `for`; what goes wrong in the thread is raised there."""

    def __init__(self, source: FrameSource) -> None:
        self.source = source
        self.unseen = 0
        """Frames that came while nobody was ready for them."""
        self.lost = 0
        """Frames that never came: gaps in the driver's counter, but for those between photographs."""
        self._changed = threading.Condition()
        self._newest: Frame | None = None
        self._ended = False
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)

    def __enter__(self) -> "Reader":
        self.source.__enter__()
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
        self._thread.join(PATIENCE)
        if not self._thread.is_alive():  # a device that hangs in the driver is left to the end of the process
            self.source.__exit__(kind, value, trace)

    def __iter__(self) -> Iterator[Frame]:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._newest or self._ended)
                frame, self._newest = self._newest, None
                self._changed.notify_all()
            if frame is not None:
                yield frame
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

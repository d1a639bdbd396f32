"""The newest moment of several cameras, however slow its user is.

Each live camera has a thread of its own. Frames that belong together become a moment, of which the
newest is kept. Sources that are not live, such as recorded folders at full speed, wait to be read,
and no moment is passed over.
"""

import heapq
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from types import TracebackType

from calib.errors import RefracalError
from capture.frames import Frame, FrameSource
from capture.reader import JOIN_TIMEOUT_S, OPENING_S, SILENT_S
from capture.rig.pairing import MAX_TOLERANCE_S, Moment, Pairing
from capture.rig.rig_sources import align_playback


class RigReader:
    """A reader that opens the sources by `with` and reads moments by `for`; an error in a thread is
    raised in the `for`, with the name of the camera.
    """

    def __init__(
        self,
        sources: Mapping[str, FrameSource],
        on_silence: Callable[[str, float], object] = lambda _name, _seconds: None,
        on_frame: Callable[[str, Frame], object] = lambda _name, _frame: None,
    ) -> None:
        """`on_silence` gets once a second the camera that has sent nothing for the longest time,
        and that time in s. `on_frame` gets every frame of a live source, in its camera's thread.
        """
        self.sources = sources
        self.skipped = 0
        """The number of moments that came while nobody was ready for them."""
        self.frames_lost = dict.fromkeys(sources, 0)
        """The number of frames that never came, by camera: the gaps in the driver's counter."""
        self.pairing = Pairing(tuple(sources))
        self._on_silence = on_silence
        self._on_frame = on_frame
        self._expected: dict[str, int] = {}
        self._arrivals: dict[str, float] = {}
        self._last_times: dict[str, float] = {}
        self._exhausted: set[str] = set()
        self._changed = threading.Condition()
        self._newest: Moment | None = None
        self._ended = False
        self._error: BaseException | None = None
        self._threads: list[threading.Thread] = []
        self._resources = ExitStack()

    @property
    def live(self) -> bool:
        return all(source.live for source in self.sources.values())

    def __enter__(self) -> "RigReader":
        with ExitStack() as stack:
            for name, source in self.sources.items():
                opening = threading.Timer(OPENING_S, self._on_silence, (name, OPENING_S))
                opening.daemon = True
                opening.start()
                try:
                    with _naming(name):
                        source.__enter__()
                finally:
                    opening.cancel()
                stack.push(source)
            by_name = align_playback(self.sources)
            self._resources = stack.pop_all()
        self.pairing = Pairing(tuple(self.sources), by_name=by_name)
        if self.live:
            now_s = time.monotonic()
            for name in self.sources:
                self._arrivals[name] = now_s
                thread = threading.Thread(target=self._run, args=(name,), name=name, daemon=True)
                self._threads.append(thread)
                thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
        for thread in self._threads:
            thread.join(JOIN_TIMEOUT_S)
        if not any(thread.is_alive() for thread in self._threads):
            self._resources.close()  # a device that hangs stays open until the process ends

    def __iter__(self) -> Iterator[Moment]:
        return self._live_moments() if self.live else self._read_moments()

    def close(self) -> None:
        """End the iteration, from any thread or a signal handler."""
        with self._changed:
            self._ended, self._newest = True, None
            self._changed.notify_all()
        for source in self.sources.values():
            source.close()

    def _read_moments(self) -> Iterator[Moment]:
        streams = [self._frames(name) for name in self.sources]
        for _, _, name, frame in heapq.merge(*streams, key=lambda entry: entry[:2]):
            for moment in self.pairing.add(name, frame):
                if self._ended:
                    return
                yield moment

    def _frames(self, name: str) -> Iterator[tuple[float, str, str, Frame]]:
        """Yield the frames of a source with what orders them among those of the others."""
        with _naming(name):
            for frame in self.sources[name]:
                self._count_lost(name, frame)
                yield frame.time_s, frame.name, name, frame

    def _live_moments(self) -> Iterator[Moment]:
        while True:
            with self._changed:
                arrived = self._changed.wait_for(lambda: self._newest or self._ended, SILENT_S)
                moment, self._newest = self._newest, None
            if moment is not None:
                yield moment
            elif not arrived:
                name = min(self._arrivals, key=lambda camera: self._arrivals[camera])
                self._on_silence(name, time.monotonic() - self._arrivals[name])
            elif self._error:
                raise self._error
            else:
                return

    def _run(self, name: str) -> None:
        try:
            with _naming(name):
                for frame in self.sources[name]:
                    self._on_frame(name, frame)
                    if not self._offer(name, frame):
                        return
        except BaseException as error:
            self._error = error
        with self._changed:
            self._exhausted.add(name)
            self._ended |= self._error is not None or len(self._exhausted) == len(self.sources)
            self._changed.notify_all()

    def _offer(self, name: str, frame: Frame) -> bool:
        """Pair a frame; return False once the iteration has ended."""
        with self._changed:
            ends = [self._last_times.get(camera, 0.0) for camera in self._exhausted]
            if ends and frame.time_s > min(ends) + MAX_TOLERANCE_S:
                self._ended = True  # an exhausted source has no partner for this frame
                self._changed.notify_all()
            if self._ended:
                return False
            self._arrivals[name] = time.monotonic()
            self._last_times[name] = frame.time_s
            self._count_lost(name, frame)
            for moment in self.pairing.add(name, frame):
                self.skipped += self._newest is not None
                self._newest = moment
                self._changed.notify_all()
            return True

    def _count_lost(self, name: str, frame: Frame) -> None:
        if name in self._expected and not frame.isolated:
            self.frames_lost[name] += max(frame.sequence - self._expected[name], 0)
        self._expected[name] = frame.sequence + 1


@contextmanager
def _naming(name: str) -> Iterator[None]:
    """Put the camera's name before the sentence of an error."""
    try:
        yield
    except RefracalError as error:
        raise type(error)(f"{name}: {error}") from error

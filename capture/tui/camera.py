"""The camera's thread behind the collecting screen: frames in, what to show out.

It touches no widget.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.reduced import reduced
from calib.session.shutter import Shutter as SensorShutter
from capture.finders import make_finder
from capture.frames import Frame, FrameSource
from capture.reader import Reader
from capture.recorder import Recorder
from capture.recording_loop import RecordingPlan, ShutterButton, Step, detect_in_pictures, record
from capture.session_file import Setup, board_of
from capture.sources.registry import open_source

PREVIEW = 192  # px, the longer side of what the screen is given: as much as a terminal shows
SHARP = 780  # px, likewise, about, for a phone of 390 points, which has two pixels or three in each
INTERVAL_S = 1 / 15  # between two pictures on the screen


@dataclass(frozen=True, slots=True)
class Task:
    """What to record, from where."""

    session: Path
    source: str
    asked: Setup
    """Board, camera and cover for a session that has no session.yaml yet."""
    bare: bool
    """The cover is off."""

    @property
    def folder(self) -> Path:
        return self.session / ("bare" if self.bare else "frames")

    @property
    def covered(self) -> bool:
        """The pictures are taken through a cover."""
        return not self.bare and self.asked[2].shape != "none"


@dataclass(frozen=True, slots=True, eq=False)
class Preview:
    """A frame as the screen shows it."""

    grey: NDArray[np.uint8]
    """(h, w), PREVIEW px at most."""
    size: tuple[int, int]
    """Width and height of the frame itself, px."""
    image: NDArray[np.uint8]
    """(h, w) or (h, w, 3) BGR: about SHARP px if that was asked for, else PREVIEW."""

    @staticmethod
    def of(pixels: NDArray[np.uint8], *, sharp: bool = False) -> "Preview":
        height, width = pixels.shape[:2]
        middle = reduced(pixels, shown_factor((width, height)))
        scale = min(PREVIEW / max(middle.shape[:2]), 1.0)
        high, wide = (max(round(side * scale), 1) for side in middle.shape[:2])
        small = np.asarray(cv2.resize(middle, (wide, high), interpolation=cv2.INTER_AREA), np.uint8)
        grey = small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
        return Preview(np.asarray(grey, np.uint8), (width, height), middle if sharp else small)


def shown_factor(size: tuple[int, int]) -> int:
    """By how much a frame of this width and height is reduced for a phone: in whole blocks, fifty
    times as fast as to exactly SHARP px.
    """
    return max(min(round(max(size) / SHARP), *size), 1)


class Shown:
    """A source whose frames are also shown, as often as a person can see, however slowly they are
    judged.
    """

    def __init__(self, source: FrameSource, show: Callable[[NDArray[np.uint8]], object]) -> None:
        """`show` gets the frame's pixels."""
        self._source = source
        self._show = show
        self._last_s = -np.inf

    @property
    def live(self) -> bool:
        return self._source.live

    @property
    def remarks(self) -> Sequence[str]:
        return self._source.remarks

    @property
    def shutter(self) -> SensorShutter | None:
        return self._source.shutter

    def __enter__(self) -> Self:
        self._source.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._source.__exit__(kind, value, trace)

    def __iter__(self) -> Iterator[Frame]:
        for frame in self._source:
            if (
                frame.time_s - self._last_s >= INTERVAL_S and not frame.isolated
            ):  # a photograph is shown with what was found in it
                self._last_s = frame.time_s
                self._show(frame.pixels)
            yield frame

    def close(self) -> None:
        self._source.close()


class Watch:
    """One stretch of recording. `close` ends it from any thread, also before it has begun."""

    def __init__(
        self,
        task: Task,
        shutter: ShutterButton,
        show: Callable[[Preview], object],
        waits: Callable[[float], object] = lambda _: None,
        sharp: Callable[[], bool] = lambda: False,
    ) -> None:
        """`show` gets the frames, sharp if `sharp` says so just then, and `waits` the seconds for
        which none came; each from a thread of its own.
        """
        self.remarks: Sequence[str] = ()
        """What a person should know of this recording, as it comes up."""
        self.closed = False
        self._task = task
        self._shutter = shutter
        self._show = show
        self._sharp = sharp
        self._reader = Reader(Shown(open_source(task.source), self._preview), waits)

    def run(self, begun: Callable[[Sequence[NDArray[np.float64]]], object]) -> Iterator[Step]:
        """Every frame that was judged, until the source ends. `begun` gets the corners of the views
        that are there already.

        RefracalError: the camera, the disk or the set-up keeps it from going on.
        """
        task = self._task
        described = (task.session / "session.yaml").exists()
        board = board_of(task.session, task.asked[0])
        like = None if described else task.asked
        with (
            self._reader as reader,
            Recorder(
                task.session, board, like=like, bare=task.bare, shutter=reader.source.shutter
            ) as recorder,
        ):
            finder = make_finder(board)
            kept = detect_in_pictures(recorder.pictures, finder)
            begun(tuple(kept))
            for step in record(
                reader, finder, recorder, RecordingPlan(views=None), kept, self._shutter
            ):
                self.remarks = (
                    *reader.source.remarks,
                    *recorder.remarks[not described :],
                )  # the first tells of what was just typed
                if step.frame.isolated:
                    self._preview(step.frame.pixels)
                yield step

    def _preview(self, pixels: NDArray[np.uint8]) -> None:
        self._show(Preview.of(pixels, sharp=self._sharp()))

    def close(self) -> None:
        self.closed = True
        self._reader.close()

"""The camera's thread behind the collecting screen: frames in, previews out.

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

from calib.corners.picture_scale import reduce_picture
from calib.session.shutter import Shutter as SensorShutter
from capture.finders import make_finder
from capture.frames import Frame, FrameSource
from capture.reader import Reader
from capture.recorder import Recorder
from capture.recording_loop import (
    RecordingPlan,
    ShutterButton,
    Step,
    detect_in_pictures,
    record_views,
)
from capture.session_file import Setup, board_of, picture_folder
from capture.sources.registry import open_source

PREVIEW_SIDE = 192  # px, the longer side of the screen's picture: as much as a terminal shows
PHONE_SIDE = (
    780  # px, the approximate longer side for a phone of 390 points with two or three pixels each
)
INTERVAL_S = 1 / 15  # s between two pictures on the screen


@dataclass(frozen=True, slots=True)
class Task:
    """One recording task: the session, the source and the set-up."""

    session: Path
    source: str
    setup: Setup
    """Board, camera and cover for a session that has no session.yaml yet."""
    bare: bool
    """True if the cover is off."""

    @property
    def folder(self) -> Path:
        return picture_folder(self.session, bare=self.bare)

    @property
    def covered(self) -> bool:
        """True if the pictures are taken through a cover."""
        return not self.bare and self.setup[2].shape != "none"


@dataclass(frozen=True, slots=True, eq=False)
class Preview:
    """A frame in the size that the screen shows."""

    grey: NDArray[np.uint8]
    """(h, w), at most PREVIEW_SIDE px."""
    size: tuple[int, int]
    """Width and height of the frame itself, px."""
    image: NDArray[np.uint8]
    """(h, w) or (h, w, 3) BGR: about PHONE_SIDE px if requested so, else PREVIEW_SIDE."""

    @staticmethod
    def of(pixels: NDArray[np.uint8], *, sharp: bool = False) -> "Preview":
        height, width = pixels.shape[:2]
        middle = reduce_picture(pixels, shown_factor((width, height)))
        scale = min(PREVIEW_SIDE / max(middle.shape[:2]), 1.0)
        size = max(round(middle.shape[1] * scale), 1), max(round(middle.shape[0] * scale), 1)
        small = np.asarray(cv2.resize(middle, size, interpolation=cv2.INTER_AREA), np.uint8)
        grey = small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
        return Preview(np.asarray(grey, np.uint8), (width, height), middle if sharp else small)


def shown_factor(size: tuple[int, int]) -> int:
    """Return the factor that reduces a frame of this width and height for a phone: a whole number,
    because reduction by blocks is fifty times as fast as scaling to exactly PHONE_SIDE px.
    """
    return max(min(round(max(size) / PHONE_SIDE), *size), 1)


class PreviewedSource:
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
            ):  # a photograph is shown later, with its detected board
                self._last_s = frame.time_s
                self._show(frame.pixels)
            yield frame

    def close(self) -> None:
        self._source.close()


class RecordingRun:
    """One run of recording. `close` ends it from any thread, also before it has started."""

    def __init__(
        self,
        task: Task,
        shutter: ShutterButton,
        show: Callable[[Preview], object],
        on_silence: Callable[[float], object] = lambda _: None,
        sharp: Callable[[], bool] = lambda: False,
    ) -> None:
        """`show` gets the frames, in the phone's size if `sharp` says so at that moment;
        `on_silence` gets the seconds without a frame. Each is called from its own thread.
        """
        self.remarks: Sequence[str] = ()
        """Sentences that a person should know about this recording, in the order in which they
        arise.
        """
        self.closed = False
        self._task = task
        self._shutter = shutter
        self._show = show
        self._sharp = sharp
        self._reader = Reader(PreviewedSource(open_source(task.source), self._preview), on_silence)

    def run(self, on_start: Callable[[Sequence[NDArray[np.float64]]], object]) -> Iterator[Step]:
        """Yield every judged frame, until the source ends. `on_start` gets the corners of the views
        that the session has already.

        RefracalError: the camera, the disk or the set-up prevents the recording.
        """
        task = self._task
        is_described = (task.session / "session.yaml").exists()
        board = board_of(task.session, task.setup[0])
        like = None if is_described else task.setup
        with (
            self._reader as reader,
            Recorder(
                task.session, board, like=like, bare=task.bare, shutter=reader.source.shutter
            ) as recorder,
        ):
            finder = make_finder(board)
            view_corners = detect_in_pictures(recorder.pictures, finder)
            on_start(tuple(view_corners))
            for step in record_views(
                reader, finder, recorder, RecordingPlan(views=None), view_corners, self._shutter
            ):
                self.remarks = (
                    *reader.source.remarks,
                    *recorder.remarks[not is_described :],
                )  # the first remark repeats what the person has just typed
                if step.frame.isolated:
                    self._preview(step.frame.pixels)
                yield step

    def _preview(self, pixels: NDArray[np.uint8]) -> None:
        self._show(Preview.of(pixels, sharp=self._sharp()))

    def close(self) -> None:
        self.closed = True
        self._reader.close()

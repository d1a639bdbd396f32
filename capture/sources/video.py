"""The source that reads a video file, frame by frame, as fast as it can be read.

A video's compression moves corners; a lossless one (FFV1, say) does not.
"""

import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from calib.errors import InputError
from calib.io.videos import breaks_off, convert_command, open_video, promised_frames
from calib.session.schema import Section
from calib.session.shutter import Shutter
from capture.frames import Frame
from capture.sources.registry import Inventory
from capture.typed_path import expand_typed_path


class VideoSource:
    live = False
    remarks: Sequence[str] = ()
    shutter: Shutter | None = None

    def __init__(self, file: Path) -> None:
        self._file = file
        self._closed = threading.Event()

    def __enter__(self) -> Self:
        self._capture = open_video(self._file)
        self._next = self._read()
        if self._next is None:
            self._capture.release()
            raise InputError(
                f"{self._file} is not a video that can be read: give a folder of its frames, or"
                f" convert it by `{convert_command(self._file)}`."
            )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._capture.release()

    def __iter__(self) -> Iterator[Frame]:
        start_s, sequence = time.monotonic(), 0
        while (frame := self._next) is not None and not self._closed.is_set():
            pixels, time_s = frame
            yield Frame(pixels, sequence, start_s + time_s)
            self._next = self._read()
            sequence += 1
        declared = promised_frames(self._capture, self._file)
        if not self._closed.is_set() and breaks_off(sequence, declared):
            raise InputError(
                f"{self._file} breaks off after {sequence} of {declared} frames: copy it again, or"
                " convert it."
            )

    def close(self) -> None:
        self._closed.set()

    def _read(self) -> tuple[np.ndarray, float] | None:
        """Return (H, W, 3) uint8 BGR and the seconds from the beginning; None at the end."""
        good, pixels = self._capture.read()
        return (
            (np.asarray(pixels, np.uint8), self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000)
            if good
            else None
        )


def open_source(place: str, options: Section) -> VideoSource:
    if options.values:
        raise InputError(
            f"{options.file}: a video has no options: leave out what follows the question mark."
        )
    return VideoSource(expand_typed_path(place))


def inventory() -> Inventory:
    return Inventory()

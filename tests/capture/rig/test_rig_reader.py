"""Live cameras in their threads: the moments that come, and a camera that is unplugged."""

import threading
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Self

import numpy as np
import pytest

from calib.session.shutter import Shutter
from capture.errors import CaptureError
from capture.frames import Frame
from capture.rig.rig_reader import RigReader


class Camera:
    """A live camera that sends a frame as often as it is asked to, and is then unplugged or
    closed.
    """

    live = True
    remarks: Sequence[str] = ()
    shutter: Shutter | None = None

    def __init__(self, offset_s: float, sequences: Sequence[int], *, unplugged: bool) -> None:
        self._offset_s = offset_s
        self._sequences = sequences
        self._unplugged = unplugged
        self._closed = threading.Event()
        self.turn = threading.Semaphore(0)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def __iter__(self) -> Iterator[Frame]:
        for sequence in self._sequences:
            self.turn.acquire()
            if self._closed.is_set():
                return
            yield Frame(np.zeros((2, 2), np.uint8), sequence, sequence / 10 + self._offset_s)
        self.turn.acquire()
        if self._unplugged and not self._closed.is_set():
            raise CaptureError("The camera was unplugged.")

    def close(self) -> None:
        self._closed.set()
        self.turn.release()


def test_moments_come_until_a_camera_is_unplugged_which_is_named() -> None:
    cameras = {
        "left": Camera(0.0, range(6), unplugged=False),
        "right": Camera(0.008, (0, 1, 3, 4, 5), unplugged=True),
    }
    offsets: list[float] = []

    def read(reader: RigReader) -> None:
        for moment in reader:
            frames = moment.frames
            offsets.append(frames["right"].time_s - frames["left"].time_s)
            for camera in cameras.values():
                camera.turn.release(6)

    with RigReader(cameras) as reader:
        for camera in cameras.values():
            camera.turn.release(2)
        with pytest.raises(CaptureError, match=r"right: The camera was unplugged\."):
            read(reader)
    assert offsets
    assert offsets == pytest.approx([0.008] * len(offsets))
    assert reader.frames_lost == {"left": 0, "right": 1}


def test_a_closed_reader_ends_without_an_error() -> None:
    cameras = {name: Camera(0.0, range(3), unplugged=True) for name in ("left", "right")}
    with RigReader(cameras) as reader:
        for camera in cameras.values():
            camera.turn.release(2)
        assert next(iter(reader)).spread_s == 0
        reader.close()
        assert list(reader) == []

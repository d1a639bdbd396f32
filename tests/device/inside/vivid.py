"""In the guest: faults of a camera, feigned by the driver vivid while `capture record` runs.

Usage: python -m tests.device.inside.vivid SHARED
"""

import json
import os
import shutil
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from capture.sources.registry import open_source
from capture.streaming.statistics import StreamStatistics
from capture.streaming.stream import Stream
from tests.device.inside.controls import set_control
from tests.device.inside.recording import Recording, pictures

DEVICE = "/dev/video0"
SOURCE = f"v4l2:{DEVICE}?size=320x180"
SESSIONS = Path("/tmp/sessions")


def start(session: str, *options: str) -> Recording:
    return Recording(
        SESSIONS / session, SOURCE, "--board", "9x9", "--square-mm", "20", "--all", *options
    )


@contextmanager
def opened() -> Iterator[int]:
    handle = os.open(DEVICE, os.O_RDWR)
    try:
        yield handle
    finally:
        os.close(handle)


def unplugged() -> dict[str, Any]:
    """After five pictures. The driver plugs in again once nobody holds the device open any more."""
    recording = start("unplugged")
    recording.wait_for(4)
    with opened() as handle:
        earlier = pictures(SESSIONS / "unplugged")
        pulled = time.monotonic()
        set_control(handle, "Disconnect")
        ended = recording.ended(pulled)
        return {**ended, "before": earlier, "again": start("unplugged").ended()}


def plugged_in_again() -> dict[str, Any]:
    return start("unplugged", "--views", "3").ended()


def dropped() -> dict[str, Any]:
    """Half of the buffers never come."""
    with opened() as handle:
        set_control(handle, "Percentage of Dropped Buffers", 50)
        try:
            return start("dropped", "--views", "20").ended()
        finally:
            set_control(handle, "Percentage of Dropped Buffers", 0)


def whole() -> dict[str, Any]:
    """The same with a camera that drops nothing."""
    return start("whole", "--views", "20").ended()


def silent() -> dict[str, Any]:
    """Open a device that streams and never gives a buffer."""
    with opened() as handle:
        set_control(handle, "Percentage of Dropped Buffers", 100)
        try:
            return start("silent").ended()
        finally:
            set_control(handle, "Percentage of Dropped Buffers", 0)


def refusing() -> dict[str, Any]:
    """Open a device that refuses to stream."""
    over = threading.Event()

    def refuse() -> None:
        with opened() as handle:
            while not over.wait(0.002):
                set_control(handle, "Inject VIDIOC_STREAMON Error")

    thread = threading.Thread(target=refuse)
    thread.start()
    try:
        return start("refusing").ended()
    finally:
        over.set()
        thread.join()


class Unchanged:
    """The straightener of a stream without maps, which would load torch."""

    depth_images = None

    def straighten(self, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return pixels


class Script:
    """A target and a listener that unplugs the camera after five pictures, and ends the stream five
    pictures after it is back.
    """

    def __init__(self) -> None:
        self.sentences: list[str] = []
        self.shapes: set[tuple[int, ...]] = set()
        options = {"colour": "yes", "auto": "yes"}
        source = partial(open_source, SOURCE, camera_options=options)
        self.stream = Stream(source, Unchanged(), [self], self)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def show(self, picture: np.ndarray) -> None:
        self.shapes.add(picture.shape)

    def tell(self, sentence: str) -> None:
        self.sentences.append(sentence)

    def report_silence(self, seconds: float) -> None: ...

    def report_counts(self, statistics: StreamStatistics) -> None:
        if statistics.frames == 5:
            with opened() as handle:
                set_control(handle, "Disconnect")
        if statistics.frames == 10:
            self.stream.close()


def streamed() -> dict[str, Any]:
    """A stream whose camera is unplugged, and plugged in again when nobody holds it open."""
    script = Script()
    ended = script.stream.run()
    return {
        "ended": ended,
        "sentences": script.sentences,
        "shapes": sorted(script.shapes),
        **script.stream.statistics.as_json(),
    }


STEPS = (streamed, unplugged, plugged_in_again, dropped, whole, silent, refusing)
shared = Path(sys.argv[1])
(shared / "result.json").write_text(json.dumps({step.__name__: step() for step in STEPS}))
if SESSIONS.exists():
    shutil.copytree(SESSIONS, shared / "sessions")

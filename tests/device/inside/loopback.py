"""In the guest: a loopback device shows one picture in each format, then a session's pictures, each
when the one before is recorded, then it is a camera that sends a picture every three seconds.
Before all that, the target of `calib stream` writes pictures there. At last, two devices show the
pictures of a rig, the second one 8 ms after the first.

Usage: python -m tests.device.inside.loopback FIXTURE RIG SHARED
"""

import json
import os
import shutil
import sys
import threading
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calib.io.images import list_images, read_grey
from capture.errors import CaptureError
from capture.sources.registry import open_source
from capture.streaming.loopback import LoopbackTarget
from tests.device.inside.feed import BUFFERS, DEVICE, SECOND, feeding, written_every
from tests.device.inside.recording import PATIENCE, Recording

fixture, pair, shared = map(Path, sys.argv[1:])
session, rig = Path("/tmp/session"), Path("/tmp/rig")
SHOWN_S = 1.0
"""Between two frames of the rig's first moment, until it is recorded: the tolerance of pairs
follows from the time between frames.
"""
OFFSET_S = 0.008
"""The second camera of the rig is later by this."""


def furthest(pixels: str) -> int | str:
    """Grey levels between a picture of noise, whose sides few numbers divide, and what the source
    makes of it in that format.
    """
    shown = np.random.default_rng(0).integers(0, 256, (250, 322)).astype(np.uint8)
    buffer = BUFFERS[pixels](shown)
    try:
        with (
            feeding(pixels, 322, 250) as handle,
            written_every(0.05, handle, buffer),
            open_source(f"v4l2:{DEVICE}?format={pixels}") as source,
        ):
            grey = next(iter(source)).pixels
    except CaptureError as error:
        return str(error)
    if pixels == "MJPG":  # lossy: what it shows is what is in the file
        shown = np.asarray(
            cv2.imdecode(np.frombuffer(buffer, np.uint8), cv2.IMREAD_GRAYSCALE), np.uint8
        )
    return int(np.abs(grey.astype(int) - shown).max())


def recorded() -> dict[str, Any]:
    views = list_images(fixture / "frames")
    height, width = read_grey(views[0]).shape
    cover = ("--cover-from", str(fixture / "session.yaml"), "--board", "9x9", "--square-mm", "20")
    with feeding("YUYV", width, height) as feed:
        for _ in range(2):  # OpenCV passes over a camera's first frame
            os.write(feed, BUFFERS["YUYV"](np.asarray(read_grey(views[0]), np.uint8)))
        recording = Recording(
            session, f"v4l2:{DEVICE}", *cover, "--all", "--views", str(len(views))
        )
        for number, view in enumerate(views[1:]):
            buffer = BUFFERS["YUYV"](np.asarray(read_grey(view), np.uint8))
            recording.wait_for(number)
            os.write(feed, buffer)
        return recording.ended()


def slow() -> dict[str, Any]:
    buffer = BUFFERS["GREY"](np.random.default_rng(0).integers(0, 256, (250, 322)).astype(np.uint8))
    with feeding("GREY", 322, 250) as handle, written_every(3.0, handle, buffer):
        options = ("--board", "9x9", "--square-mm", "20", "--all", "--views", "3")
        return Recording(
            Path("/tmp/slow"), f"v4l2:{DEVICE}?patience_s={PATIENCE:.0f}", *options
        ).ended()


def recorded_rig() -> dict[str, Any]:
    """Return what became of the recording of a rig, and the seconds from each frame of the first
    camera to that of the second, as they were written.
    """
    for name in ("left", "right"):
        (rig / name).mkdir(parents=True)
        shutil.copy(pair / name / "session.yaml", rig / name)
    shutil.copy(pair / "rig.yaml", rig)
    views = list_images(pair / "left" / "frames")
    height, width = read_grey(views[0]).shape
    offsets: list[float] = []
    with (
        feeding("YUYV", width, height) as left,
        feeding("YUYV", width, height, SECOND) as right,
    ):

        def show(view: Path) -> None:
            buffers = [
                BUFFERS["YUYV"](np.asarray(read_grey(pair / name / "frames" / view.name), np.uint8))
                for name in ("left", "right")
            ]
            os.write(left, buffers[0])
            written = time.monotonic()
            time.sleep(OFFSET_S)
            os.write(right, buffers[1])
            offsets.append(time.monotonic() - written)

        for _ in range(2):  # before that, the devices have no format
            show(views[0])
        recording = Recording(
            rig,
            f"left=v4l2:{DEVICE}?patience_s={PATIENCE:.0f}",
            *("--source", f"right=v4l2:{SECOND}?patience_s={PATIENCE:.0f}"),
            "--all",
        )
        while recording.running and not recording.count:
            show(views[0])
            time.sleep(SHOWN_S)
        for view in views[1:]:
            count = recording.count
            show(view)
            while recording.running and recording.count < count + 2:
                time.sleep(0.01)
        recording.interrupt()
        return {**recording.ended(), "offsets_s": offsets}


def streamed() -> dict[str, Any]:
    """Return the grey levels between a picture of three colours that a stream's target writes to
    the device and what OpenCV, and our own source, read there; and the format that they find.
    """
    size = 320, 240
    shown = np.zeros((size[1], size[0], 3), np.uint8)
    for column, colour in enumerate(((200, 60, 40), (40, 180, 90), (30, 90, 220))):
        shown[:, 112 * column : 112 * (column + 1)] = colour
    inner = (slice(16, 224), slice(16, 96))  # within one colour: two pixels share theirs
    over = threading.Event()
    results: dict[str, Any] = {}

    def furthest_from(pixels: np.ndarray) -> int:
        return int(np.abs(pixels[inner].astype(int) - shown[inner]).max())

    def stream() -> None:
        while not over.wait(0.05):
            target.show(shown)

    with LoopbackTarget(DEVICE, size) as target:
        target.show(shown)
        thread = threading.Thread(target=stream)
        thread.start()
        try:
            video = cv2.VideoCapture(DEVICE, cv2.CAP_V4L2)
            success, pixels = video.read()
            results["opencv"] = furthest_from(np.asarray(pixels)) if success else "no picture"
            video.release()
            with open_source(f"v4l2:{DEVICE}?colour=yes") as source:
                results["colour"] = furthest_from(next(iter(source)).pixels)
            with open_source(f"v4l2:{DEVICE}") as source:
                results["format"] = source._pixels  # type: ignore[attr-defined]
                results["size"] = next(iter(source)).size
        finally:
            over.set()
            thread.join()
    return results


result = {
    "streamed": streamed(),
    "formats": {pixels: furthest(pixels) for pixels in BUFFERS},
    **recorded(),
    "slow": slow(),
    "rig": recorded_rig(),
}
(shared / "result.json").write_text(json.dumps(result))
for folder in (session, rig):
    if folder.exists():
        shutil.copytree(folder, shared / folder.name)

"""A feed for a loopback device: pictures in the formats that cameras send."""

import os
import struct
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from fcntl import ioctl

import cv2
import numpy as np
from numpy.typing import NDArray

DEVICE = "/dev/video0"
SECOND = "/dev/video1"
S_FMT, OUTPUT = 0xC0D05605, 2
Grey = NDArray[np.uint8]


def _with_chroma(grey: Grey) -> bytes:
    """Planes of half the height and width follow, and none of their values is a neutral one."""
    return grey.tobytes() + bytes(range(1, 101)) * (grey.size // 200)


def _jpeg(grey: Grey) -> bytes:
    return bytes(cv2.imencode(".jpg", grey)[1])


BUFFERS: Mapping[str, Callable[[Grey], bytes]] = {
    "GREY": lambda grey: grey.tobytes(),
    "YUYV": lambda grey: np.stack([grey, np.full_like(grey, 128)], -1).tobytes(),
    "UYVY": lambda grey: np.stack([np.full_like(grey, 128), grey], -1).tobytes(),
    "NV12": _with_chroma,
    "YU12": _with_chroma,
    "MJPG": _jpeg,
}
"""The buffer that a camera sends for a picture, by format."""


@contextmanager
def feeding(pixels: str, width: int, height: int, device: str = DEVICE) -> Iterator[int]:
    """The descriptor to which a camera's buffers are written."""
    handle = os.open(device, os.O_RDWR)
    try:
        code, size = int.from_bytes(pixels.encode(), "little"), 2 * width * height
        ioctl(
            handle, S_FMT, struct.pack("=I4x8I168x", OUTPUT, width, height, code, 1, 0, size, 8, 0)
        )
        yield handle
    finally:
        os.close(handle)


@contextmanager
def written_every(seconds: float, handle: int, buffer: bytes) -> Iterator[None]:
    """The same picture again and again, first at once: before that, the device has no format."""
    over = threading.Event()

    def feed() -> None:
        while not over.wait(seconds):
            os.write(handle, buffer)

    os.write(handle, buffer)
    thread = threading.Thread(target=feed)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()

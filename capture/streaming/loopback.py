"""The target that is a camera: a loopback device of v4l2loopback, which other programs open like
any webcam. They get I420 pictures (YU12).

A reader that is slow misses pictures, and does not hold up the stream: the driver keeps the newest.
"""

import errno
import os
import struct
from fcntl import ioctl
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from capture.sources.v4l2_device import QUERYCAP
from capture.streaming.planar import PlanarConverter
from capture.streaming.target import TargetError

S_FMT = 0xC0D05605
OUTPUT = 2  # V4L2_BUF_TYPE_VIDEO_OUTPUT, and V4L2_CAP_VIDEO_OUTPUT
PROGRESSIVE = 1
SRGB = 8
YU12 = b"YU12"


class LoopbackTarget:
    def __init__(self, path: str, size: tuple[int, int]) -> None:
        """`size` is the width and height, px."""
        self._path = path
        self._size = size
        self._converter = PlanarConverter(*size)

    def __enter__(self) -> Self:
        self._handle = _open(self._path)
        try:
            self._set_format()
        except BaseException:
            os.close(self._handle)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.close(self._handle)

    def show(self, picture: NDArray[np.uint8]) -> None:
        try:
            os.write(self._handle, self._converter.convert(picture).data)
        except BlockingIOError:  # every buffer is with a reader, and this picture is passed over
            return
        except OSError as error:
            raise TargetError(
                f"{self._path} takes no more pictures ({error.strerror}): load v4l2loopback again,"
                " and run the same command."
            ) from error

    def _set_format(self) -> None:
        width, height = self._size
        code = int.from_bytes(YU12, "little")
        row, total = width, width * height * 3 // 2
        wanted = (width, height, code, PROGRESSIVE, row, total, SRGB, 0)
        try:
            answer = ioctl(self._handle, S_FMT, struct.pack("=I4x8I168x", OUTPUT, *wanted))
        except OSError as error:
            if error.errno == errno.EBUSY:
                raise TargetError(
                    f"{self._path} gets pictures from another program: end that one (fuser -v"
                    f" {self._path} names it), or choose another device."
                ) from error
            raise TargetError(
                f"{self._path} takes no pictures of {width}x{height} px ({error.strerror}): choose"
                " another size by --scale."
            ) from error
        given_width, given_height, given_code = struct.unpack_from("=3I", answer, 8)
        if (given_width, given_height, given_code) != (width, height, code):
            raise TargetError(
                f"{self._path} keeps the format that it had, {given_width}x{given_height} px: close"
                " the programs that show it, and run the same command."
            )


def _open(path: str) -> int:
    """Return the descriptor of a device that takes pictures; TargetError says why it is none."""
    number = path.removeprefix("/dev/video")
    where = f" video_nr={number}" if number.isdecimal() else ""
    load = f"sudo modprobe v4l2loopback{where} exclusive_caps=1 card_label=Straight"
    try:
        if Path(path).exists() and not Path(path).is_char_device():
            raise TargetError(f"{path} is not a device: write one, such as v4l2:/dev/video9.")
        handle = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        if error.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.ENOTDIR):
            raise TargetError(
                f"{path} is not there: make it by {load} (sudo apt install v4l2loopback-dkms brings"
                " the driver)."
            ) from error
        advice = "run sudo usermod -aG video $USER and log in again"
        if error.errno not in (errno.EACCES, errno.EPERM):
            advice = f"end the program that uses it (fuser -v {path} names it)"
        raise TargetError(f"{path} cannot be opened ({error.strerror}): {advice}.") from error
    try:
        fields = struct.unpack_from("=2I", ioctl(handle, QUERYCAP, bytes(104)), 84)
    except OSError:
        fields = 0, 0
    if not (fields[1] or fields[0]) & OUTPUT:
        os.close(handle)
        raise TargetError(
            f"{path} is a camera, or no video device, and takes no pictures: make a loopback device"
            " by sudo modprobe v4l2loopback video_nr=9 exclusive_caps=1, and write"
            " v4l2:/dev/video9."
        )
    return handle

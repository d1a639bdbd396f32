"""The answers of a V4L2 driver about its pictures, with the driver faked at the system call."""

import errno
import os
import struct
import time
from itertools import islice

import cv2
import numpy as np
import pytest

from capture.errors import CaptureError
from capture.sources import v4l2_device as device
from capture.sources.registry import open_source
from capture.sources.v4l2_formats import COLOURS, FORMATS, ROWS

CASES = [
    ("GREY", 322, 322 * 250, 0),
    ("GREY", 384, 384 * 250, 62),
    ("YUYV", 644, 644 * 250, 0),
    ("YUYV", 704, 704 * 250, 60),
    ("NV12", 322, 322 * 375, 0),
    ("NV12", 384, 384 * 375, 62),
    ("NV12", 483, 322 * 375, 0),  # a driver that counts chroma into a row
    ("YU12", 0, 0, 0),  # one that says nothing
]


@pytest.mark.parametrize(("pixels", "row", "total", "added"), CASES)
def test_padded_rows_are_told_from_packed_ones(
    monkeypatch: pytest.MonkeyPatch, pixels: str, row: int, total: int, added: int
) -> None:
    """Pictures of 322x250 px."""

    def ioctl(_handle: int, request: int, argument: bytes) -> bytes:
        assert request == device.G_FMT
        assert len(argument) == request >> 16 & 0x3FFF
        return struct.pack(
            "=I4x6I176x",
            device.CAPTURE,
            322,
            250,
            int.from_bytes(pixels.encode(), "little"),
            1,
            row,
            total,
        )

    monkeypatch.setattr(device, "ioctl", ioctl)
    assert device.padding(3, *ROWS[pixels]) == added


def test_a_driver_that_gives_no_row_length_is_taken_to_pad_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def ioctl(*_: object) -> bytes:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(device, "ioctl", ioctl)
    assert device.padding(3, 1, 1.0) == 0


def test_every_format_but_jpeg_has_rows() -> None:
    assert set(FORMATS) - set(ROWS) == {"MJPG"}


def test_every_colour_format_gives_the_colour_that_was_sent() -> None:
    """One colour, so that halved colours lose nothing, of BT.601 from 16 to 235."""
    picture = np.full((8, 16, 3), (40, 120, 200), np.uint8)
    planes = cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420)
    y = int(planes[0, 0])
    u = int(planes[8, 0])
    v = int(planes[10, 0])
    grey = np.full((8, 16), y, np.uint8)
    pairs = np.full((4, 8, 2), (u, v), np.uint8)
    buffers = {
        "YUYV": np.tile(np.array([y, u, y, v], np.uint8), 8 * 8),
        "UYVY": np.tile(np.array([u, y, v, y], np.uint8), 8 * 8),
        "NV12": np.concatenate([grey.ravel(), pairs.ravel()]),
        "YU12": planes.ravel(),
        "MJPG": cv2.imencode(".jpg", picture)[1].ravel(),
    }
    assert buffers.keys() == COLOURS.keys() == FORMATS.keys() - {"GREY"}
    for name, buffer in buffers.items():
        pixels = COLOURS[name](np.asarray(buffer, np.uint8), 16, 8)
        assert pixels is not None
        np.testing.assert_allclose(pixels.astype(int), picture, atol=3, err_msg=name)
    assert COLOURS["MJPG"](np.zeros(9, np.uint8), 16, 8) is None


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("", {"focus": 0, "exposure": 1, "gain": 0, "white": 0}),
        ("?auto=yes", {"focus": 0, "exposure": 3, "gain": 1, "white": 1}),
        ("?auto=yes&exposure_us=2000", {"focus": 0, "exposure": 1, "gain": 1, "white": 1}),
        ("?auto=yes&gain=5", {"focus": 0, "exposure": 3, "gain": 0, "white": 1}),
    ],
)
def test_what_is_automatic_follows_the_light_and_the_focus_does_not(
    camera: "Camera", monkeypatch: pytest.MonkeyPatch, options: str, expected: dict[str, int]
) -> None:
    controls = {
        device.FOCUS_AUTO: 1,
        device.EXPOSURE_AUTO: 0,
        device.AUTOGAIN: 1,
        device.AUTO_WHITE_BALANCE: 0,
        device.EXPOSURE_100US: 10,
        device.GAIN: 3,
    }

    def ioctl(handle: int, request: int, argument: bytes = b"") -> bytes:
        number = int.from_bytes(argument[:4], "little")
        if request in (device.QUERYCTRL, device.G_CTRL, device.S_CTRL) and number in controls:
            if request == device.S_CTRL:
                controls[number] = struct.unpack("=Ii", argument)[1]
            value = struct.pack("=Ii", number, controls[number])
            return value if request == device.G_CTRL else argument
        return camera.ioctl(handle, request, argument)

    monkeypatch.setattr(device, "ioctl", ioctl)
    camera.interval = 0.0
    with open_source(f"v4l2:/dev/null{options}"):
        names = ("focus", "exposure", "gain", "white")
        assert dict(zip(names, list(controls.values())[:4], strict=True)) == expected


class Camera:
    """A driver with one mode, 64x48 grey, and OpenCV's way to read it: a wait that ends without a
    picture is not an error.
    """

    def __init__(self, interval: float) -> None:
        self.interval = interval
        """s, from frame to frame"""
        self.next_s = 0.0
        self.plugged_in = True

    def ioctl(self, _handle: int, request: int, argument: bytes = b"") -> bytes:
        index = int.from_bytes(argument[:4], "little")
        if not self.plugged_in:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        if request == device.QUERYCAP:
            return struct.pack(
                "=16s32s32sIII12x",
                b"fake",
                b"Fake",
                b"bus",
                1,
                device.CAPTURE | device.STREAMING,
                0,
            )
        if request == device.ENUM_FMT and index == 0:
            return struct.pack("=44x4s16x", b"GREY")
        if request == device.ENUM_FRAMESIZES and index == 0:
            return struct.pack("=8x3I24x", 1, 64, 48)
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    def open(self, *_: object) -> bool:
        return True

    def get(self, number: int) -> float:
        return {cv2.CAP_PROP_FRAME_WIDTH: 64.0, cv2.CAP_PROP_FRAME_HEIGHT: 48.0}.get(number, 0.0)

    def read(self) -> tuple[bool, object]:
        """OpenCV's wait, of 0.1 s here."""
        time.sleep(0.1)
        if not self.plugged_in or time.monotonic() < self.next_s:
            return False, None
        self.next_s = time.monotonic() + self.interval
        return True, np.full((48, 64), 7, np.uint8)

    def release(self) -> None:
        pass


@pytest.fixture
def camera(monkeypatch: pytest.MonkeyPatch) -> Camera:
    camera = Camera(1.5)
    monkeypatch.setattr(device, "ioctl", camera.ioctl)
    monkeypatch.setattr(cv2, "VideoCapture", lambda: camera)
    return camera


@pytest.mark.slow
def test_a_camera_slower_than_a_frame_a_second_is_waited_for(camera: Camera) -> None:
    with open_source("v4l2:/dev/null") as source:
        frames = list(islice(source, 3))
    assert [frame.size for frame in frames] == [(64, 48)] * 3
    assert frames[2].time_s - frames[0].time_s >= 2 * camera.interval


def test_a_camera_that_falls_silent_is_given_up_after_what_was_asked_for(camera: Camera) -> None:
    camera.interval = 600.0
    with open_source("v4l2:/dev/null?patience_s=1") as source:
        frames = iter(source)
        next(frames)
        start_s = time.monotonic()
        with pytest.raises(CaptureError, match="sends no more pictures"):
            next(frames)
    assert 1 <= time.monotonic() - start_s < 9, "the default is 10 s"


def test_an_unplugged_camera_is_reported_at_once(camera: Camera) -> None:
    with open_source("v4l2:/dev/null?patience_s=600") as source:
        frames = iter(source)
        next(frames)
        camera.plugged_in = False
        with pytest.raises(CaptureError, match="was unplugged: plug the camera in again"):
            next(frames)

"""What a V4L2 driver says of its pictures, with the driver faked at the system call."""

import errno
import struct

import pytest

from capture.sources import v4l2_device as device
from capture.sources.v4l2_formats import FORMATS, ROWS

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


@pytest.mark.parametrize(("pixels", "row", "whole", "added"), CASES)
def test_padded_rows_are_told_from_packed_ones(monkeypatch: pytest.MonkeyPatch, pixels: str, row: int, whole: int, added: int) -> None:
    """Pictures of 322x250 px."""

    def ioctl(_handle: int, request: int, argument: bytes) -> bytes:
        assert request == device.G_FMT
        assert len(argument) == request >> 16 & 0x3FFF
        return struct.pack("=I4x6I176x", device.CAPTURE, 322, 250, int.from_bytes(pixels.encode(), "little"), 1, row, whole)

    monkeypatch.setattr(device, "ioctl", ioctl)
    assert device.padding(3, *ROWS[pixels]) == added


def test_a_driver_that_refuses_to_say_is_taken_to_pad_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def ioctl(*_: object) -> bytes:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(device, "ioctl", ioctl)
    assert device.padding(3, 1, 1.0) == 0


def test_every_format_but_jpeg_has_rows() -> None:
    assert set(FORMATS) - set(ROWS) == {"MJPG"}

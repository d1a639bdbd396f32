"""The loopback device, with the driver faked at the system call: the format that it is asked for,
the bytes that it gets, and a sentence for each refusal. tests/device has the real driver.
"""

import errno
import os
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from capture.sources.v4l2_device import QUERYCAP
from capture.streaming import loopback
from capture.streaming.loopback import OUTPUT, S_FMT, LoopbackTarget
from capture.streaming.target import TargetError

SIZE = (64, 48)
COLOUR = np.full((48, 64, 3), (30, 160, 200), np.uint8)


class Driver:
    """A driver whose device is a file."""

    def __init__(self) -> None:
        self.capabilities = OUTPUT
        self.refusal = 0
        """The error of S_FMT; 0 if it succeeds."""
        self.size = SIZE
        """The width and height that it answers, px."""
        self.asked: tuple[int, ...] = ()

    def ioctl(self, _handle: int, request: int, argument: bytes) -> bytes:
        assert len(argument) == request >> 16 & 0x3FFF
        if request == QUERYCAP:
            return struct.pack("=84xII12x", self.capabilities, self.capabilities)
        assert request == S_FMT
        if self.refusal:
            raise OSError(self.refusal, os.strerror(self.refusal))
        self.asked = struct.unpack_from("=I4x8I", argument)
        return argument[:8] + struct.pack("=2I", *self.size) + argument[16:]


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> Driver:
    driver = Driver()
    monkeypatch.setattr(loopback, "ioctl", driver.ioctl)
    monkeypatch.setattr(Path, "is_char_device", lambda _: True)
    return driver


@pytest.mark.parametrize("picture", [COLOUR, COLOUR[..., 1]], ids=["colour", "grey"])
def test_the_device_gets_planes_that_decode_to_the_picture(
    driver: Driver, tmp_path: Path, picture: np.ndarray
) -> None:
    device = tmp_path / "video9"
    device.touch()
    with LoopbackTarget(str(device), SIZE) as target:
        target.show(np.ascontiguousarray(picture))
    code = int.from_bytes(b"YU12", "little")
    assert driver.asked[:7] == (OUTPUT, 64, 48, code, 1, 64, 64 * 48 * 3 // 2)
    planes = np.frombuffer(device.read_bytes(), np.uint8).reshape(72, 64)
    decoded = cv2.cvtColor(planes, cv2.COLOR_YUV2BGR_I420)
    expected = picture if picture.ndim == 3 else picture[..., None].repeat(3, 2)
    np.testing.assert_allclose(decoded.astype(int), expected, atol=3)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"capabilities": 1}, "is a camera, or no video device, and takes no pictures"),
        ({"refusal": errno.EBUSY}, "gets pictures from another program: end that one"),
        ({"refusal": errno.EINVAL}, "takes no pictures of 64x48 px .* another size by --scale"),
        ({"size": (640, 480)}, "keeps the format that it had, 640x480 px: close the programs"),
    ],
)
def test_a_device_that_refuses_says_why(
    driver: Driver, tmp_path: Path, change: dict[str, object], sentence: str
) -> None:
    device = tmp_path / "video9"
    device.touch()
    for name, value in change.items():
        setattr(driver, name, value)
    with pytest.raises(TargetError, match=sentence), LoopbackTarget(str(device), SIZE):
        pass


def test_a_device_that_is_not_there_says_how_to_make_it() -> None:
    command = "sudo modprobe v4l2loopback video_nr=77 exclusive_caps=1"
    with pytest.raises(TargetError, match=command), LoopbackTarget("/dev/video77", SIZE):
        pass


def test_a_file_is_no_device(tmp_path: Path) -> None:
    (tmp_path / "film").touch()
    with (
        pytest.raises(TargetError, match="is not a device"),
        LoopbackTarget(str(tmp_path / "film"), SIZE),
    ):
        pass


def test_a_device_that_goes_away_is_reported(
    driver: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write(*_: object) -> int:
        raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))

    device = tmp_path / "video9"
    device.touch()
    with LoopbackTarget(str(device), SIZE) as target:
        monkeypatch.setattr(os, "write", write)
        with pytest.raises(TargetError, match="takes no more pictures"):
            target.show(COLOUR)
    assert driver.asked

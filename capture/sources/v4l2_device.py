"""The kernel's interface of a V4L2 node: its identity, its modes and its controls. Functions on a
file descriptor, without OpenCV.

Numbers and layouts are those of linux/videodev2.h; they are the same on every machine for the calls
used here.
"""

import errno
import os
import struct
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fcntl import ioctl
from pathlib import Path

from capture.errors import CaptureError

QUERYCAP, ENUM_FMT, ENUM_FRAMESIZES, ENUM_FRAMEINTERVALS = (
    0x80685600,
    0xC0405602,
    0xC02C564A,
    0xC034564B,
)
G_FMT = 0xC0D05604  # where pointers have 8 bytes
QUERYCTRL, G_CTRL, S_CTRL = 0xC0445624, 0xC008561B, 0xC008561C
REQBUFS, QBUF, STREAMON = 0xC0145608, 0xC058560F, 0x40045612
CAPTURE = 1  # V4L2_BUF_TYPE_VIDEO_CAPTURE, and V4L2_CAP_VIDEO_CAPTURE
STREAMING = 0x04000000
MMAP = 1
DISABLED = 0x0001

AUTO_WHITE_BALANCE, AUTOGAIN, GAIN, WHITE_BALANCE = 0x0098090C, 0x00980912, 0x00980913, 0x0098091A
EXPOSURE_AUTO, EXPOSURE_100US, EXPOSURE_PRIORITY = 0x009A0901, 0x009A0902, 0x009A0903
FOCUS, FOCUS_AUTO = 0x009A090A, 0x009A090C
LOCKED = {FOCUS_AUTO: 0, EXPOSURE_AUTO: 1, EXPOSURE_PRIORITY: 0, AUTOGAIN: 0, AUTO_WHITE_BALANCE: 0}
"""The controls that let a camera change itself, and the value that stops it."""
AUTOMATIC = {EXPOSURE_AUTO: (3, 0), AUTOGAIN: (1,), AUTO_WHITE_BALANCE: (1,)}
"""The controls that may follow the light, and the values that let them, the most usual first: a
camera whose exposure alone is automatic has 3, one whose aperture is as well 0.
"""
NAMES = {
    FOCUS_AUTO: "focus",
    EXPOSURE_AUTO: "exposure",
    EXPOSURE_PRIORITY: "frame rate",
    AUTOGAIN: "gain",
    AUTO_WHITE_BALANCE: "white balance",
}


class NoCameraError(CaptureError):
    """The node captures nothing: it belongs to a codec or to a loopback device without input."""


@dataclass(frozen=True, slots=True)
class Mode:
    format: str
    """The four characters of its pixel format."""
    width: int
    height: int
    fps: float = 0.0
    """The highest rate; 0 if the driver does not report it."""
    scales: bool = False
    """True if the camera gives any size up to this one."""

    def supports(self, size: tuple[int, int]) -> bool:
        return size == (self.width, self.height) or (
            self.scales and size[0] <= self.width and size[1] <= self.height
        )

    def __str__(self) -> str:
        limit = "up to " if self.scales else ""
        rate = f" {self.fps:g} fps" if self.fps else ""
        return f"{self.format} {limit}{self.width}x{self.height}{rate}"


@contextmanager
def open_node(path: str) -> Iterator[int]:
    """Open a node that captures video, and give its descriptor; CaptureError says why that is
    impossible.
    """
    try:
        if Path(path).exists() and not Path(path).is_char_device():
            raise CaptureError(
                f"{path} is not a device: `capture sources` lists the cameras of this machine."
            )
        handle = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise CaptureError(_reason(path, error)) from error
    try:
        try:
            fields = struct.unpack_from("=2I", ioctl(handle, QUERYCAP, bytes(104)), 84)
        except OSError as error:
            unplugged = error.errno == errno.ENODEV
            raise CaptureError(
                _reason(path, error)
                if unplugged
                else f"{path} is not a camera: `capture sources` lists the cameras."
            ) from error
        capabilities = (
            fields[1] or fields[0]
        )  # those of this node, or of the device as a whole where the driver is old
        if not (capabilities & CAPTURE and capabilities & STREAMING):
            raise NoCameraError(
                f"{path} gives no video: choose another node of the camera, or start what feeds it"
                " if it is a loopback device."
            )
        yield handle
    finally:
        os.close(handle)


def read_name(handle: int) -> str:
    """Return the camera's name."""
    return str(ioctl(handle, QUERYCAP, bytes(104))[16:48].split(b"\0")[0].decode(errors="replace"))


def modes(handle: int) -> list[Mode]:
    """Return the modes that the camera offers, in its own order."""
    offered = []
    for index in range(64):
        try:
            entry = ioctl(handle, ENUM_FMT, struct.pack("=2I56x", index, CAPTURE))
        except OSError:
            break
        pixels = entry[44:48]
        name = pixels.decode("ascii", "replace").strip()
        offered += [
            Mode(name, w, h, _fastest(handle, pixels, w, h), scales)
            for w, h, scales in _sizes(handle, pixels)
        ]
    return offered


def padding(handle: int, pixel: int, rows: float) -> int:
    """Return the bytes that the driver adds to each row of grey values, where a pixel takes `pixel`
    bytes; 0 where they are unknown.

    `rows` rows of that length make one row of the picture, chroma included. Some drivers count
    chroma into the length: then the picture is too small for rows of that length.
    """
    if struct.calcsize("P") != 8:
        return 0
    try:
        answer = ioctl(handle, G_FMT, struct.pack("=I204x", CAPTURE))
    except OSError:
        return 0
    width, height, _, _, row, total = struct.unpack_from("=6I", answer, 8)
    return max(row - width * pixel, 0) if total >= int(row * height * rows) else 0


def follow_light(handle: int, controls: Collection[int]) -> None:
    """Let the camera change some of the controls of AUTOMATIC by itself, as far as it can."""
    for control in controls:
        if read(handle, control) is None:
            continue
        for value in AUTOMATIC[control]:
            with suppress(OSError):
                write(handle, control, value)
                break


def lock(handle: int, automatic: Collection[int] = ()) -> list[str]:
    """Lock focus, exposure, gain and white balance at their present values. Return a sentence for
    each that the camera keeps changing.

    Args:
        automatic: the controls that stay as they are.
    """
    remarks = []
    for control, value in LOCKED.items():
        if control in automatic or read(handle, control) is None:
            continue
        try:
            write(handle, control, value)
        except OSError as error:
            remarks.append(
                f"The camera keeps changing its {NAMES[control]} ({error.strerror}): light and"
                " distance should not change."
            )
    return remarks


def read(handle: int, control: int) -> int | None:
    """Return a control's value; None where the camera has no such control."""
    with suppress(OSError):
        flags = struct.unpack_from(
            "=I", ioctl(handle, QUERYCTRL, struct.pack("=I64x", control)), 56
        )[0]
        if not flags & DISABLED:
            return int(
                struct.unpack("=Ii", ioctl(handle, G_CTRL, struct.pack("=Ii", control, 0)))[1]
            )
    return None


def write(handle: int, control: int, value: int) -> None:
    """Set a control; OSError says why that is impossible."""
    ioctl(handle, S_CTRL, struct.pack("=Ii", control, value))


def explain_silence(path: str) -> str:
    """Return a sentence that says why a camera that opens gives no picture."""
    try:
        with open_node(path) as handle:
            ioctl(handle, REQBUFS, struct.pack("=3I8x", 2, CAPTURE, MMAP))
            if struct.calcsize("P") == 8:  # the layout below needs pointers of 8 bytes
                for index in range(2):
                    ioctl(handle, QBUF, struct.pack("=2I52xI24x", index, CAPTURE, MMAP))
                ioctl(handle, STREAMON, struct.pack("=I", CAPTURE))
    except CaptureError as error:
        return str(error)
    except OSError as error:
        if error.errno in (errno.EBUSY, errno.ENODEV):
            return _reason(path, error)
        if error.errno == errno.ENOSPC:
            return (
                f"{path} has too little bandwidth on its USB bus: plug the camera into another"
                " port, or choose a smaller ?size=."
            )
        return (
            f"{path} opens but does not stream ({error.strerror}): plug the camera in again, or"
            " choose another mode by ?size= and ?format=."
        )
    return (
        f"{path} can be opened but sends no pictures: plug the camera in again, into a port of its"
        " own, or choose another mode by ?size=."
    )


def is_connected(handle: int) -> bool:
    """Return True if the camera is still plugged in."""
    try:
        ioctl(handle, QUERYCAP, bytes(104))
    except OSError:
        return False
    return True


def _reason(path: str, error: OSError) -> str:
    match error.errno:
        case errno.ENOENT | errno.ENOTDIR:
            return (
                f"{path} is not there: plug the camera in; `capture sources` lists the cameras of"
                " this machine."
            )
        case errno.EACCES | errno.EPERM:
            return (
                f"{path} may not be opened ({error.strerror}): run sudo usermod -aG video $USER and"
                " log in again."
            )
        case errno.EBUSY:
            return (
                f"{path} is in use by another program: close that one (fuser -v {path} names it)."
            )
        case errno.ENODEV | errno.ENXIO:
            return f"{path} is not connected any more: plug the camera in again."
    return (
        f"{path} cannot be opened ({error.strerror}): `capture sources` lists the cameras of this"
        " machine."
    )


def _sizes(handle: int, pixels: bytes) -> Iterator[tuple[int, int, bool]]:
    """Yield width, height, and whether those are the largest of a range."""
    for index in range(256):
        try:
            kind, *fields = struct.unpack_from(
                "=7I", ioctl(handle, ENUM_FRAMESIZES, struct.pack("=I4s36x", index, pixels)), 8
            )
        except OSError:
            return
        if (
            kind != 1
        ):  # a range: the smallest width, the largest, the step, and the same of the height
            yield fields[1], fields[4], True
            return
        yield fields[0], fields[1], False


def _fastest(handle: int, pixels: bytes, width: int, height: int) -> float:
    """Return the highest rate in frames per second; 0 where the driver does not report it."""
    fastest = 0.0
    for index in range(256):
        try:
            entry = ioctl(
                handle, ENUM_FRAMEINTERVALS, struct.pack("=I4s2I36x", index, pixels, width, height)
            )
        except OSError:
            break
        kind, numerator, denominator = struct.unpack_from("=3I", entry, 16)
        fastest = max(fastest, denominator / numerator if numerator else 0.0)
        if kind != 1:  # a range: its shortest interval comes first
            break
    return fastest

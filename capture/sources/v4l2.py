"""The source of a V4L2 camera: a webcam, a capture card, or a loopback device.

`v4l2:/dev/video0?size=1640x1232&format=YUYV`; without options, the largest pictures of the best
format that the camera has. The driver's own grey values are kept: those of YUYV are its Y, not a
colour picture converted to grey. `exposure_us`, `gain` and `focus` (in the driver's units) set
controls that are otherwise held at their present value; `patience_s` is the time that a connected
camera may send nothing. `colour=yes` gives BGR pictures instead of grey ones; with `auto=yes` the
controls that are not stated follow the light, all but the focus.
"""

import os
import threading
import time
from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from calib.errors import InputError
from calib.session.schema import Quantity, Section
from calib.session.shutter import Shutter
from capture.errors import CaptureError
from capture.frames import Frame
from capture.sources import v4l2_device as device
from capture.sources.options import (
    AUTO,
    COLOUR,
    EXPOSURE_US,
    GAIN,
    PATIENCE_S,
    read_number,
    read_size,
    read_switch,
)
from capture.sources.registry import Inventory, ListedCamera
from capture.sources.v4l2_formats import COLOURS, FORMATS, ROWS, Grey, Picture

os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "1")
"""The time in s that OpenCV waits for a frame; after it, the source checks that the camera is still
plugged in.

OpenCV reads this at its first use.
"""

# s, the maximum age of a frame that has just come: an older time is not from this clock
MAX_FRAME_AGE = 5.0
FOCUS = Quantity("focus", low=0, high=1e5)
RAW_CAMERA_ADVICE = "a Raspberry Pi's camera is read by libcamera:0 or rpicam:0."


class V4l2Source:
    live = True
    shutter: Shutter | None = None

    def __init__(
        self,
        path: str,
        size: tuple[int, int] | None = None,
        pixels: str | None = None,
        controls: Mapping[int, int] | None = None,
        patience_s: float = 10.0,
        *,
        colour: bool = False,
        automatic: Collection[int] = (),
    ) -> None:
        """`controls` are set after the locking, by their V4L2 numbers; those that are `automatic`
        follow the light.
        """
        self.remarks: Sequence[str] = ()
        self._path = path
        self._size = size
        self._pixels = pixels
        self._controls = controls or {}
        self._patience_s = patience_s
        self._colour = colour
        self._automatic = automatic
        self._closed = threading.Event()
        self._open = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._handle = stack.enter_context(device.open_node(self._path))
            mode = self._mode()
            device.follow_light(self._handle, self._automatic)
            remarks = device.lock(self._handle, self._automatic)
            for control, value in self._controls.items():
                try:
                    device.write(self._handle, control, value)
                except OSError as error:
                    raise CaptureError(
                        f"{self._path} refuses a control set to {value} ({error.strerror}): leave"
                        " that option out."
                    ) from error
            if mode.format == "MJPG":
                remarks.append(
                    "The camera compresses its pictures, which moves corners a little: choose an"
                    " uncompressed format if it has one."
                )
            self.remarks = remarks
            self._capture = cv2.VideoCapture()
            stack.callback(self._capture.release)
            self._start(mode)
            self._open = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._open.close()

    def __iter__(self) -> Iterator[Frame]:
        pixels, time_s = self._first
        sequence, nominal = 0, 1 / (self._capture.get(cv2.CAP_PROP_FPS) or 30.0)  # s
        recent: deque[float] = deque(maxlen=15)  # s, from frame to frame
        while not self._closed.is_set():
            yield Frame(pixels, sequence, time_s, self._read_controls())
            previous_s = time_s
            if (picture := self._take()) is None:
                return
            pixels, time_s = picture
            elapsed = time_s - previous_s  # OpenCV hides the driver's counter, but not its clock
            sequence += max(round(elapsed / max(nominal, min(recent))), 1) if recent else 1
            recent.append(elapsed)

    def close(self) -> None:
        self._closed.set()

    def _mode(self) -> device.Mode:
        """Return the largest mode that fits the requested options, in the best format."""
        offered = [mode for mode in device.modes(self._handle) if mode.format in FORMATS]
        fit = [
            m
            for m in offered
            if (self._size is None or m.supports(self._size)) and self._pixels in (None, m.format)
        ]
        if not fit:
            if not offered:
                raise CaptureError(
                    f"{self._path} has none of the formats {', '.join(FORMATS)}:"
                    f" {RAW_CAMERA_ADVICE}"
                )
            raise CaptureError(
                f"{self._path} has no such mode: choose ?size= and ?format= from those that"
                " `capture sources` lists."
            )
        best = min(
            fit,
            key=lambda m: (
                m.format == "MJPG",
                -m.width * m.height,
                self._colour and m.format not in COLOURS,
                list(FORMATS).index(m.format),
            ),
        )
        if self._size:
            return replace(best, width=self._size[0], height=self._size[1])
        if best.scales:
            raise InputError(
                f"{self._path} gives any size up to {best.width}x{best.height} px: write the one"
                " you want, as ?size=1640x1232."
            )
        return best

    def _start(self, mode: device.Mode) -> None:
        """Start to stream, and read a first picture: a camera that was unplugged still opens."""
        self._pixels, self._size = mode.format, (mode.width, mode.height)
        code = cv2.VideoWriter.fourcc(*mode.format)
        wanted = (
            (cv2.CAP_PROP_FOURCC, code),
            (cv2.CAP_PROP_FRAME_WIDTH, mode.width),
            (cv2.CAP_PROP_FRAME_HEIGHT, mode.height),
            (cv2.CAP_PROP_CONVERT_RGB, 0),
        )
        if not self._capture.open(
            self._path, cv2.CAP_V4L2, [number for pair in wanted for number in pair]
        ):
            raise CaptureError(device.explain_silence(self._path))
        width = int(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH))
        height = int(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        if (width, height) != self._size:
            raise CaptureError(
                f"{self._path} gives pictures of {width}x{height} px: write"
                f" ?size={width}x{height} after the source."
            )
        if mode.format in ROWS and (added := device.padding(self._handle, *ROWS[mode.format])):
            raise CaptureError(
                f"{self._path} adds {added} bytes to each row of its {mode.format} pictures of this"
                " size, which OpenCV ignores: choose another ?size= or ?format=."
            )
        try:
            first = self._take()
        except CaptureError as error:
            self._capture.release()
            raise CaptureError(device.explain_silence(self._path)) from error
        if first is None:
            raise CaptureError(f"{self._path} was closed before its first picture.")
        self._first = first

    def _take(self) -> tuple[Picture, float] | None:
        """Return the next picture and its time in s; None once closed. It skips damaged buffers."""
        start_s = time.monotonic()
        while not self._closed.is_set():
            good, raw = self._capture.read()
            if good and (pixels := self._decode(np.asarray(raw, np.uint8))) is not None:
                arrival_s = time.monotonic()
                driver_s = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
                # some drivers have another clock
                is_monotonic = 0 <= arrival_s - driver_s < MAX_FRAME_AGE
                return pixels, driver_s if is_monotonic else arrival_s
            if not good and not device.is_connected(self._handle):
                raise CaptureError(
                    f"{self._path} was unplugged: plug the camera in again, and run the same"
                    " command to continue."
                )
            if time.monotonic() - start_s > self._patience_s:
                raise CaptureError(
                    f"{self._path} sends no more pictures: plug the camera in again, and run the"
                    " same command to continue."
                )
            if not good:
                self._closed.wait(0.01)
        return None

    def _decode(self, raw: Grey) -> Picture | None:
        """Return the picture of a raw buffer; None for a damaged one."""
        width, height = self._size or (0, 0)
        name = self._pixels or "GREY"
        try:
            in_colour = self._colour and name in COLOURS
            pixels = (COLOURS if in_colour else FORMATS)[name](raw, width, height)
        except (ValueError, cv2.error):  # the buffer has another length
            return None
        return None if pixels is None or pixels.shape[:2] != (height, width) else np.array(pixels)

    def _read_controls(self) -> dict[str, float | str]:
        """Return the values of the controls that the camera has."""
        state: dict[str, float | str] = {}
        for key, control, unit in (
            ("exposure_us", device.EXPOSURE_100US, 100.0),
            ("gain", device.GAIN, 1.0),
            ("focus", device.FOCUS, 1.0),
            ("white_balance_k", device.WHITE_BALANCE, 1.0),
        ):
            if (value := device.read(self._handle, control)) is not None:
                state[key] = value * unit
        return state


def open_source(place: str, options: Section) -> V4l2Source:
    options.allow_only(
        ("size", "format", COLOUR, AUTO, EXPOSURE_US.key, GAIN.key, FOCUS.key, PATIENCE_S.key),
        "known option",
    )
    pixels = (
        options.choice("format", tuple(FORMATS), f"one of {', '.join(FORMATS)}")
        if "format" in options.values
        else None
    )
    controls = {}
    for control, quantity, unit in (
        (device.EXPOSURE_100US, EXPOSURE_US, 100),
        (device.GAIN, GAIN, 1),
        (device.FOCUS, FOCUS, 1),
    ):
        if (value := read_number(options, quantity)) is not None:
            controls[control] = round(value / unit)
    automatic = set(device.AUTOMATIC) if read_switch(options, AUTO) else set()
    automatic -= {device.EXPOSURE_AUTO} if device.EXPOSURE_100US in controls else set()
    automatic -= {device.AUTOGAIN} if device.GAIN in controls else set()
    return V4l2Source(
        place,
        read_size(options),
        pixels,
        controls,
        read_number(options, PATIENCE_S) or 0.0,
        colour=read_switch(options, COLOUR),
        automatic=automatic,
    )


def inventory() -> Inventory:
    cameras = []
    nodes = sorted(
        Path("/dev").glob("video[0-9]*"), key=lambda node: int(node.name.removeprefix("video"))
    )
    for node in nodes:
        source = f"v4l2:{node}"
        try:
            with device.open_node(str(node)) as handle:
                modes = [mode for mode in device.modes(handle) if mode.format in FORMATS]
                problem = (
                    ""
                    if modes
                    else f"It has no picture format that can be read: {RAW_CAMERA_ADVICE}"
                )
                cameras.append(
                    ListedCamera(source, device.read_name(handle), tuple(map(str, modes)), problem)
                )
        except device.NoCameraError:
            continue
        except CaptureError as error:
            cameras.append(ListedCamera(source, "", (), str(error)))
    if cameras:
        return Inventory(tuple(cameras))
    return Inventory(
        missing=(
            f"None of {len(nodes)} nodes captures video: plug a camera in."
            if nodes
            else "There is no /dev/video*: plug a camera in."
        )
    )

"""The source of a Raspberry Pi's camera through the program rpicam-vid, which needs no Python
bindings.

`rpicam:0?size=1640x1232&exposure_us=8000&gain=1&lens_position=2.0`; `mode=3280:2464:10:P` selects
the sensor's mode, `awbgains=1.8,1.6` the colours, `fps=10` the rate. Focus, exposure, gain and
white balance are fixed from the start. The program writes YUV420 with rows padded to 64 bytes; its
Y plane is the full-range grey picture. `colour=yes` gives BGR pictures instead; with
`auto=yes` exposure, gain and white balance that are not stated follow the light. With `sync=server`
or `sync=client` the frames of several cameras begin at the same time, by libcamera's software
synchronisation: clients follow the server, and pictures come once they do.
"""

import os
import re
import selectors
import shutil
import subprocess
import threading
import time
from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from types import TracebackType
from typing import IO, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.io.numerals import whole_number
from calib.session.schema import Quantity, Section
from calib.session.shutter import Shutter
from capture.errors import CaptureError
from capture.frames import Frame
from capture.sensors import sensor_in, shutter_of
from capture.sources.options import AUTO, COLOUR, read_number, read_size, read_switch
from capture.sources.registry import Inventory, ListedCamera

ROW_ALIGNMENT = 64  # bytes, the alignment of a row
START_TIMEOUT = 10.0  # s, the maximum until the first picture: the program sets up the sensor
SILENCE_TIMEOUT = 1.5  # s, the maximum delay in addition to the frame's own time
NAME_TIMEOUT = 5.0  # s, the maximum until the program names the sensor, before its first picture
SYNC_FRAMES = 300  # frames, the maximum until clients follow the server; libcamera plans for 100
LINES_TIMEOUT = 1.0  # s, the wait for the program's lines about the first picture
INSTALL = "sudo apt install rpicam-apps"
QUANTITIES = (
    Quantity("exposure_us", low=1, high=1e7, default=8000.0),
    Quantity("gain", low=1, high=1000, default=1.0),
    Quantity("lens_position", low=0, high=100, default=0.0),
    Quantity("fps", low=0.1, high=1000, default=10.0),
)
SYNC = "sync"
SERVER, CLIENT = "server", "client"
"""The values of the option `sync`."""
LIGHT = ("exposure_us", "gain", "awbgains")
"""The settings that may follow the light."""
CONFIGURED = re.compile(r"configuring streams: \(0\) (\d+)x(\d+)")
SELECTED_FORMAT = "Selected sensor format"
"""The beginning of the line that names the opened camera."""
FRAME_LINE = re.compile(r"^#\d+ .* exp (?P<exposure_us>[0-9.]+) ag (?P<gain>[0-9.]+)")
"""The line that the program prints for each frame when it has no preview window."""


REMARKS = {
    SERVER: "its frames set the time of the other cameras' frames (libcamera's synchronisation)",
    CLIENT: "its frames begin when those of the camera with sync=server do",
}
"""What a synchronised camera says of itself."""


class RpicamSource:
    live = True
    shutter: Shutter | None = None

    def __init__(
        self,
        camera: int,
        size: tuple[int, int],
        settings: Mapping[str, float],
        mode: str,
        awbgains: str,
        *,
        colour: bool = False,
        automatic: Collection[str] = (),
        sync: str = "",
    ) -> None:
        """`automatic` are the settings, exposure_us, gain or awbgains, that follow the light;
        `sync` is server or client, or empty for a camera with a time of its own.
        """
        self.remarks: Sequence[str] = (REMARKS[sync],) if sync else ()
        self._sync = sync
        self._size = size
        self._colour = colour
        self._fps = settings["fps"]
        self._state: dict[str, float | str] = {
            key: value for key, value in settings.items() if key != "fps" and key not in automatic
        }
        fixed = {
            "exposure_us": ("--shutter", f"{settings['exposure_us']:.0f}"),
            "gain": ("--gain", f"{settings['gain']:g}"),
            "awbgains": ("--awbgains", awbgains),
        }
        if "awbgains" not in automatic:
            self._state["awbgains"] = awbgains.replace(",", " ")
        self._state |= {"mode": mode} if mode else {}
        self._command = [
            *(
                "rpicam-vid",
                "--nopreview",
                "--timeout",
                "0",
                "--camera",
                str(camera),
                "--codec",
                "yuv420",
                "--flush",
            ),
            *("--width", str(size[0]), "--height", str(size[1]), "--framerate", f"{self._fps:g}"),
            *("--autofocus-mode", "manual", "--lens-position", f"{settings['lens_position']:g}"),
            *(word for key, words in fixed.items() if key not in automatic for word in words),
            *("--denoise", "off", *(("--mode", mode) if mode else ())),
            *(("--sync", sync) if sync else ()),
            *("--output", "-"),
        ]
        self._lines: deque[str] = deque(maxlen=50)
        self._framed = threading.Event()
        """Set once the program has printed a frame's line, and so all lines before it: the camera
        and its sizes.
        """
        self._named = threading.Event()
        """Set once the program has named the camera's sensor, or prints no more lines."""
        self._closed = False

    def __enter__(self) -> Self:
        pipe = subprocess.PIPE
        try:  # in a separate process session: we handle Ctrl-C
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.DEVNULL,
                stdout=pipe,
                stderr=pipe,
                start_new_session=True,
                env={
                    **os.environ,
                    "LIBCAMERA_LOG_LEVELS": "*:INFO",
                },  # it then prints the size that it configures
            )
        except OSError as error:
            raise CaptureError(
                f"rpicam-vid cannot be started ({error.strerror}): on Raspberry Pi OS, run"
                f" {INSTALL}."
            ) from error
        assert self._process.stdout
        assert self._process.stderr
        self._pipe = self._process.stdout
        self._listener = threading.Thread(
            target=self._listen, args=(self._process.stderr,), daemon=True
        )
        self._listener.start()
        try:
            self._first = None
            if self._sync:  # its first picture may wait for another camera
                self._named.wait(NAME_TIMEOUT)
            else:
                self._first = self._take_first()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
        try:
            self._process.wait(2)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._pipe.close()
        self._listener.join(2)

    def __iter__(self) -> Iterator[Frame]:
        frame, sequence = self._first or self._take_first(), 0
        while frame is not None:
            yield frame
            sequence += 1
            frame = self._take(sequence, SILENCE_TIMEOUT + 1 / self._fps)

    def close(self) -> None:
        self._closed = True
        self._process.terminate()

    def _take_first(self) -> Frame | None:
        """Return the first picture; None when closed."""
        wait = SYNC_FRAMES / self._fps if self._sync else 0.0
        frame = self._take(0, START_TIMEOUT + wait)
        if frame is None and not self._closed:
            raise self._failure("ended before its first picture")
        self._framed.wait(LINES_TIMEOUT)
        return frame

    def _take(self, sequence: int, patience: float) -> Frame | None:
        """Return the next picture; None when closed, or when the program ended as it should.

        An incomplete frame is dropped.
        """
        width, height = self._size
        stride = -(-width // ROW_ALIGNMENT) * ROW_ALIGNMENT
        buffer = bytearray(stride * height + 2 * (stride // 2) * (height // 2))
        view, filled = memoryview(buffer), 0
        with selectors.DefaultSelector() as selector:
            selector.register(self._pipe, selectors.EVENT_READ)
            deadline = time.monotonic() + patience
            while filled < len(buffer) and not self._closed:
                if not selector.select(max(deadline - time.monotonic(), 0)):
                    raise self._failure(f"has sent nothing for {patience:.1f} s")
                count = os.readv(self._pipe.fileno(), [view[filled:]])
                if count == 0:
                    self._check_end(filled)
                    return None
                filled += count
        if self._closed:
            return None
        self._check_configured()
        pixels = np.frombuffer(buffer, np.uint8, stride * height).reshape(height, stride)[:, :width]
        if self._colour:
            pixels = _with_colour(pixels, np.frombuffer(buffer, np.uint8)[stride * height :])
        return Frame(np.ascontiguousarray(pixels), sequence, time.monotonic(), dict(self._state))

    def _check_end(self, filled: int) -> None:
        code = self._process.wait()
        self._listener.join(2)
        if code and not self._closed:
            raise self._failure(
                f"ended with exit code {code}{' in the middle of a picture' if filled else ''}"
            )

    def _check_configured(self) -> None:
        for line in tuple(self._lines):
            match = CONFIGURED.search(line)
            if match and (int(match[1]), int(match[2])) != self._size:
                raise CaptureError(
                    f"The camera gives pictures of {match[1]}x{match[2]} px: write"
                    f" ?size={match[1]}x{match[2]} after the source."
                )

    def _listen(self, stderr: IO[bytes]) -> None:
        with stderr:
            for raw in stderr:
                line = re.sub(r"\x1b\[[0-9;]*m", "", raw.decode(errors="replace")).strip()
                if state := FRAME_LINE.match(line):
                    self._state = {
                        **self._state,
                        **{key: float(value) for key, value in state.groupdict().items()},
                    }
                    self._framed.set()
                elif line:
                    self._lines.append(line)
                    if SELECTED_FORMAT in line:
                        self.shutter = shutter_of(sensor_in(line))
                        self._named.set()
        self._named.set()

    def _failure(self, event: str) -> CaptureError:
        """Return an error with the program's last complaint."""
        lines = list(self._lines)
        complaint = next(
            (line for line in reversed(lines) if "ERROR" in line or "***" in line),
            lines[-1] if lines else "nothing",
        )
        advice = "check the cable and that no other program uses the camera."
        if self._sync == CLIENT:
            advice = f"it waits for a camera of which the source says {SYNC}={SERVER}: start that."
        return CaptureError(f"rpicam-vid {event} (it said: {complaint}): {advice}")


def _with_colour(grey: NDArray[np.uint8], chroma: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the (h, w, 3) BGR picture of full-range YUV420.

    Args:
        grey: (h, w), the Y plane.
        chroma: the U plane and then the V plane, of half the height and width, with padded rows.
    """
    height, width = grey.shape
    blue, red = chroma.reshape(2, height // 2, -1)[:, :, : (width + 1) // 2]
    planes = [grey, *(cv2.resize(plane, (width, height)) for plane in (red, blue))]
    return np.asarray(cv2.cvtColor(cv2.merge(planes), cv2.COLOR_YCrCb2BGR), np.uint8)


def open_source(place: str, options: Section) -> RpicamSource:
    numbers = (quantity.key for quantity in QUANTITIES)
    options.allow_only(("size", "mode", "awbgains", SYNC, COLOUR, AUTO, *numbers), "known option")
    number = whole_number(place)
    if number is None:
        raise InputError(f"{options.file} names no camera: write its number, such as rpicam:0.")
    sync = ""
    if SYNC in options.values:
        sync = options.choice(SYNC, (SERVER, CLIENT), f"{SERVER} or {CLIENT}")
    automatic = [key for key in LIGHT if key not in options.values]
    automatic = automatic if read_switch(options, AUTO) else []
    settings = {quantity.key: read_number(options, quantity) or 0.0 for quantity in QUANTITIES}
    texts = []
    for key, default, pattern, example in (
        ("mode", "", r"\d+:\d+(:\d+(:[UP])?)?", "3280:2464:10:P"),
        ("awbgains", "1.8,1.6", r"\d+(\.\d+)?,\d+(\.\d+)?", "1.8,1.6"),
    ):
        text = options.text(key, f"text such as {example}", default)
        if text and not re.fullmatch(pattern, text):
            raise options.error(key, text, f"it like {example}")
        texts.append(text)
    return RpicamSource(
        number,
        read_size(options) or (1640, 1232),
        settings,
        texts[0],
        texts[1],
        colour=read_switch(options, COLOUR),
        automatic=automatic,
        sync=sync,
    )


def can_synchronise() -> bool:
    """Return True if the installed rpicam-vid can make several cameras begin their frames at the
    same time, as those from 2025 on can.
    """
    try:
        done = subprocess.run(
            ["rpicam-vid", "--help"], capture_output=True, text=True, timeout=20, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return f"--{SYNC} " in done.stdout + done.stderr


def inventory() -> Inventory:
    if not shutil.which("rpicam-hello"):
        return Inventory(
            missing=f"rpicam-apps is not installed: on Raspberry Pi OS, run {INSTALL}."
        )
    try:
        done = subprocess.run(
            ["rpicam-hello", "--list-cameras"],
            capture_output=True,
            text=True,
            timeout=20,
            errors="replace",
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return Inventory(
            missing=f"rpicam-hello does not answer ({error}): start the machine again."
        )
    cameras: list[ListedCamera] = []
    for line in (done.stdout + done.stderr).splitlines():
        if head := re.match(r"(\d+) : (\S+)", line):
            cameras.append(ListedCamera(f"rpicam:{head[1]}", head[2], ()))
        elif cameras and (mode := re.search(r"(\d+x\d+) \[([0-9.]+) fps", line)):
            last = cameras.pop()
            cameras.append(
                ListedCamera(last.source, last.name, (*last.modes, f"{mode[1]} {mode[2]} fps"))
            )
    missing = (
        ""
        if cameras
        else (
            "rpicam-apps sees no camera: check its cable, with the power off, and start the machine"
            " again."
        )
    )
    return Inventory(tuple(cameras), missing)

"""The target that writes pictures to stdout, for ffmpeg, GStreamer and the like: as y4m, a video
with a header and I420 pictures, or raw, the bytes of the pictures alone.
"""

import fcntl
import os
import select
import stat
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from capture.streaming.planar import PlanarConverter
from capture.streaming.target import ReaderGoneError, TargetError

STALL_S = 1.0
"""The time in s after which a reader that takes nothing is reported."""
GRACE_S = 1.0
"""The time in s for which a frame that has begun is still written when the stream ends, so that the
reader gets it whole.
"""
STDOUT = 1
POLL_MS = 100
PIPE_BYTES = 1 << 20
"""The buffer that the pipe is given, bytes: the most that a user may ask for."""


class PipeTarget:
    """Pictures to a descriptor. A reader that stalls is waited for."""

    def __init__(
        self,
        size: tuple[int, int],
        stop: threading.Event,
        tell: Callable[[str], object],
        *,
        raw: bool = False,
        rate: float = 30.0,
        descriptor: int | None = None,
    ) -> None:
        """
        Args:
            size: px, width and height.
            stop: set when the stream ends.
            tell: gets sentences about the reader.
            raw: True for pixels alone, BGR or grey.
            rate: frames a second, which the header of a y4m states.
            descriptor: of the pipe; None: stdout.
        """
        self._stop = stop
        self._tell = tell
        self._raw = raw
        self._size = size
        self._rate = rate
        self._descriptor = descriptor
        self._converter = PlanarConverter(*size)
        self._began = False

    def __enter__(self) -> Self:
        handle = STDOUT if self._descriptor is None else self._descriptor
        if os.isatty(handle):
            raise InputError(
                "The pictures would fill the terminal: pipe them into a program, such as | ffplay"
                " -, or write them into a file, > straight.y4m."
            )
        self._handle = os.dup(handle)
        kind = os.fstat(self._handle).st_mode
        self._blocking = os.get_blocking(self._handle)
        if stat.S_ISFIFO(kind) or stat.S_ISSOCK(kind):
            os.set_blocking(self._handle, False)
            with suppress(OSError):  # beyond the system's limit, or no pipe
                fcntl.fcntl(self._handle, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        self._poll = select.poll()
        self._poll.register(self._handle, select.POLLOUT)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.set_blocking(self._handle, self._blocking)  # others may have the same pipe
        os.close(self._handle)

    def show(self, picture: NDArray[np.uint8]) -> None:
        if not self._began:
            self._begin(picture)
        if self._raw:
            self._write(picture.data.cast("B"))
        else:
            self._write(b"FRAME\n")
            self._write(self._converter.convert(picture).data.cast("B"))

    def _begin(self, picture: NDArray[np.uint8]) -> None:
        width, height = self._size
        self._began = True
        if self._raw:
            pixels = "gray" if picture.ndim == 2 else "bgr24"
            self._tell(
                f"Raw pictures of {width}x{height} px, {pixels}: ffmpeg -f rawvideo -pix_fmt"
                f" {pixels} -s {width}x{height} -i -"
            )
            return
        rate = round(1000 * self._rate)
        header = f"YUV4MPEG2 W{width} H{height} F{rate}:1000 Ip A1:1 C420jpeg XCOLORRANGE=LIMITED\n"
        self._write(header.encode())

    def _write(self, content: bytes | memoryview) -> None:
        """Write all of it; less if the stream ends and the reader takes nothing."""
        remaining = memoryview(content)
        start_s = time.monotonic()
        grace_s: float | None = None
        stalled = False
        while remaining:
            if self._stop.is_set():
                grace_s = grace_s or time.monotonic() + GRACE_S
                if time.monotonic() > grace_s:
                    return
            if not self._poll.poll(POLL_MS):
                if not stalled and time.monotonic() - start_s > STALL_S:
                    stalled = True
                    self._tell("The reader of the pipe takes no pictures: waiting for it.")
                continue
            try:
                remaining = remaining[os.write(self._handle, remaining) :]
            except BlockingIOError:
                continue
            except BrokenPipeError as error:
                raise ReaderGoneError from error
            except OSError as error:
                raise TargetError(
                    f"The pictures cannot be written to stdout ({error.strerror}): send them to"
                    " another place."
                ) from error
        if stalled:
            elapsed_s = time.monotonic() - start_s
            self._tell(f"The reader of the pipe takes pictures again, after {elapsed_s:.0f} s.")

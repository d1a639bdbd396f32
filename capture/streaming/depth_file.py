"""The depth image of a stream: a file that another program replaces while the stream runs."""

import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.io.depth_image import read_depth_image

PATIENCE_S = 1.0
"""The time in s for which a file may be damaged or missing before this is reported: a program that
writes it in place leaves half of it for a moment.
"""

DepthImage = NDArray[np.float32]
Stamp = tuple[int, int, int]
"""The file's inode, its size in bytes, and the time in ns when it was written."""


class DepthFile:
    """A file of depths in the geometry of the first straight picture of a stream."""

    def __init__(self, path: Path, near: float, tell: Callable[[str], object]) -> None:
        """
        Args:
            path: of a depth image, as `calib undistort --depth-image` reads it.
            near: m, the smallest depth that counts.
            tell: gets a sentence if the file is damaged or missing, and when it is read again.
        """
        self.path = path
        self.near = near
        self.images = 0
        """The number of depth images that were read."""
        self._tell = tell
        self._stamp: Stamp | None = None
        self._failure = ""
        self._failed_since: float | None = None  # s of the monotonic clock
        self._reported = False

    def is_replaced(self) -> bool:
        """Return True if the file is another than the one that was read last. Report a file that
        has been damaged or missing for PATIENCE_S.
        """
        stamp = self._read_stamp()
        if stamp is None:
            self._stamp = None
            self.note_failure(f"{self.path} is not there.")
        elapsed_s = time.monotonic() - (self._failed_since or math.inf)
        if elapsed_s > PATIENCE_S and not self._reported:
            self._reported = True
            self._tell(f"{self._failure} The stream goes on with the depths that it read last.")
        return stamp is not None and stamp != self._stamp

    def read(self, size: tuple[int, int]) -> DepthImage:
        """Return the depths, (height, width) m, 0 where unknown.

        Args:
            size: px, the width and height of the first straight picture. The depth image may have
                fewer or more pixels, in the same proportion.

        Raises:
            InputError: the file cannot be read, or its proportion is another.
        """
        if self.path.is_dir():
            raise InputError(
                f"{self.path} is a folder: name one depth image. calib undistort takes a folder of"
                " them, with the pictures of a recording."
            )
        self._stamp = self._read_stamp()
        image = read_depth_image(self.path)
        height, width = image.shape
        if min(image.shape) < 1 or abs(width * size[1] / size[0] - height) > 1:
            raise InputError(
                f"{self.path} has {width}x{height} px, and the straight pictures"
                f" {size[0]}x{size[1]} px: write a depth for each of their pixels, or a smaller"
                " picture of the same proportion."
            )
        self.images += 1
        return image

    def note_success(self) -> None:
        """Note that the file was read; say so if its failure was reported."""
        if self._reported:
            self._tell(f"{self.path} is read again.")
        self._failed_since = None
        self._reported = False

    def note_failure(self, sentence: str) -> None:
        """Note why the file was not read. `is_replaced` reports it if it stays like this."""
        self._failure = sentence
        self._failed_since = self._failed_since or time.monotonic()

    def _read_stamp(self) -> Stamp | None:
        try:
            status = self.path.stat()
        except OSError:
            return None
        return status.st_ino, status.st_size, status.st_mtime_ns

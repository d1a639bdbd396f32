"""The source that plays back a recorded session, or any folder of pictures, as a camera would give
them.

`folder:PATH` plays a recording at its recorded times, those of frames.csv; `?speed=10` plays it ten
times as fast, `?speed=max` as fast as it can be read. Pictures without times that grow from one to
the next play as fast as they can be read. Pictures without times, or with long gaps between them,
count as single photographs.
"""

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.io.files import reading
from calib.io.frames_table import FIXED, NAME, read_table, recorded_time
from calib.io.images import TYPES, conversion_of_unread, list_images, read_image
from calib.io.numerals import whole_number
from calib.session.schema import Quantity, Section
from calib.session.shutter import Shutter
from capture.frames import PAUSE_S, Frame
from capture.sources.options import read_number
from capture.sources.registry import Inventory
from capture.typed_path import expand_typed_path

SPEED = Quantity("speed", low=0.01, high=1000, default=1.0)


class FolderSource:
    """The pictures of a folder, each read when its time has come."""

    remarks: Sequence[str] = ()
    shutter: Shutter | None = None

    def __init__(self, folder: Path, speed: float | None) -> None:
        """`speed` is 1 for the recorded times; None: as fast as they can be read."""
        self._folder = folder
        self._speed = speed
        self._closed = threading.Event()
        self._pictures: tuple[Path, ...] = ()
        self._rows: tuple[Mapping[str, str], ...] = ()
        self._times: tuple[float | None, ...] = ()  # s
        self._origin: tuple[float, float] | None = None

    @property
    def live(self) -> bool:
        return self._speed is not None

    @property
    def recorded_start_s(self) -> float | None:
        """The recorded time of the first picture, s; None where a picture has no time. Known once
        the source is entered.
        """
        return None if None in self._times else self._times[0]

    def play_from(self, recorded_s: float, now_s: float) -> None:
        """Play back so that the recorded time `recorded_s` is `now_s` of the monotonic clock: for
        several recordings that were taken together.
        """
        self._origin = recorded_s, now_s

    def __enter__(self) -> Self:
        inner = self._folder / "frames"
        with reading(self._folder):
            self._pictures = list_images(inner if inner.is_dir() else self._folder)
        if not self._pictures:
            advice = conversion_of_unread(inner if inner.is_dir() else self._folder)
            advice = advice or f"name a session, or a folder of {TYPES} files"
            raise InputError(f"{self._folder} has no pictures that are read: {advice}.")
        table = (self._folder.parent if self._folder.name == "frames" else self._folder) / NAME
        rows = {row["file"]: row for row in read_table(table)}
        self._rows = tuple(rows.get(picture.name, {}) for picture in self._pictures)
        self._times = tuple(map(recorded_time, self._rows))
        if any(_gap(*pair) is None for pair in pairwise(self._times)) or None in self._times:
            self._speed = None
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __iter__(self) -> Iterator[Frame]:
        recorded_start = next((time_s for time_s in self._times if time_s is not None), 0.0)
        first, start_s = self._origin or (recorded_start, time.monotonic())
        near = [(_gap(*pair) or PAUSE_S) < PAUSE_S for pair in pairwise((None, *self._times, None))]
        for index, (picture, row, recorded) in enumerate(
            zip(self._pictures, self._rows, self._times, strict=True)
        ):
            elapsed = 0.0 if recorded is None else recorded - first  # s
            pixels = _pixels(picture)
            if self._closed.wait(
                max(start_s + elapsed / self._speed - time.monotonic(), 0.0) if self._speed else 0.0
            ):
                return
            metadata = {key: _value(text) for key, text in row.items() if text and key not in FIXED}
            sequence = whole_number(row.get("sequence", ""))
            yield Frame(
                pixels,
                index if sequence is None else sequence,
                start_s + elapsed,
                metadata,
                picture.name,
                isolated=not (near[index] or near[index + 1]),
            )

    def close(self) -> None:
        self._closed.set()


def open_source(place: str, options: Section) -> FolderSource:
    options.allow_only(("speed",), "known option")
    return FolderSource(
        expand_typed_path(place),
        None if options.values.get("speed") == "max" else read_number(options, SPEED),
    )


def inventory() -> Inventory:
    return Inventory()


def _pixels(picture: Path) -> NDArray[np.uint8]:
    pixels = read_image(picture)
    if pixels.dtype != np.uint8:
        raise InputError(
            f"{picture} has 16 bits a pixel where cameras give 8: convert it, or calibrate from it"
            " by `calib fit`."
        )
    return np.asarray(pixels, np.uint8)


def _gap(first: float | None, second: float | None) -> float | None:
    """Return the seconds from one picture to the next; None where they are unknown."""
    return second - first if first is not None and second is not None and second > first else None


def _value(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text

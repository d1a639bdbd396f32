"""A recorded session, or any folder of pictures, as if a camera gave them again.

`folder:PATH` gives a recording at its recorded times, frames.csv's; `?speed=10` ten times as fast, `?speed=max` as fast as it is read.
Pictures without times are given as fast as they are read.
"""

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.images import list_images, read_image
from calib.schema import Quantity, Section
from capture.frames import Frame
from capture.sources.options import read_number
from capture.sources.registry import Inventory
from capture.table import FIXED, NAME, read_table

SPEED = Quantity("speed", low=0.01, high=1000, default=1.0)


class FolderSource:
    """The pictures of a folder, each read when its time has come."""

    remarks: Sequence[str] = ()

    def __init__(self, folder: Path, speed: float | None) -> None:
        """`speed` is 1 for the recorded times; None: as fast as they are read."""
        self._folder = folder
        self._speed = speed
        self._closed = threading.Event()
        self._pictures: tuple[Path, ...] = ()
        self._rows: dict[str, dict[str, str]] = {}

    @property
    def live(self) -> bool:
        return self._speed is not None

    def __enter__(self) -> Self:
        inner = self._folder / "frames"
        self._pictures = list_images(inner if inner.is_dir() else self._folder)
        if not self._pictures:
            raise InputError(f"{self._folder} has no pictures: name a session, or a folder of png, jpg, tiff, bmp or npy files.")
        table = (self._folder.parent if self._folder.name == "frames" else self._folder) / NAME
        self._rows = {row["file"]: row for row in read_table(table)}
        if any(_time(self._rows.get(picture.name, {})) is None for picture in self._pictures):
            self._speed = None
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __iter__(self) -> Iterator[Frame]:
        begun = time.monotonic()
        first = _time(self._rows.get(self._pictures[0].name, {})) or 0.0
        for index, picture in enumerate(self._pictures):
            row = self._rows.get(picture.name, {})
            recorded = _time(row)  # s
            due = begun if recorded is None else begun + (recorded - first) / (self._speed or 1.0)
            pixels = _pixels(picture)
            if self._closed.wait(max(due - time.monotonic(), 0.0) if self._speed else 0.0):
                return
            said = {key: _value(text) for key, text in row.items() if text and key not in FIXED}
            counter = row.get("sequence", "")
            yield Frame(pixels, int(counter) if counter.isdecimal() else index, due, said, picture.name)

    def close(self) -> None:
        self._closed.set()


def open_source(place: str, options: Section) -> FolderSource:
    options.only(("speed",), "known option")
    return FolderSource(Path(place), None if options.values.get("speed") == "max" else read_number(options, SPEED))


def inventory() -> Inventory:
    return Inventory()


def _pixels(picture: Path) -> NDArray[np.uint8]:
    pixels = read_image(picture)
    if pixels.dtype != np.uint8:
        raise InputError(f"{picture} has 16 bits a pixel where cameras give 8: convert it, or calibrate from it by calib fit.")
    return np.asarray(pixels, np.uint8)


def _time(row: Mapping[str, str]) -> float | None:
    """s; None where it was not recorded."""
    try:
        time_s = float(row["time_s"])
    except (KeyError, ValueError):
        return None
    return time_s if np.isfinite(time_s) else None


def _value(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text

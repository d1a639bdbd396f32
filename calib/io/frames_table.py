"""frames.csv: one row for each picture, with the time and what the camera said.

A row is appended only after its picture is on the disk, so a recording that is cut short leaves at
worst a row without its end, or a picture without a row. Both are mended when the recording is
continued.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.errors import InputError, brief
from calib.io.files import MOST_TEXT, read_file, reading
from calib.io.numerals import whole_number

NAME = "frames.csv"
FIXED = ("file", "time_s", "sequence", "view")
"""The columns that every recording has: the picture's name, Unix time in s, the driver's counter,
and the number of the board's pose, which the pictures of a burst share. What the camera said comes
after them.
"""

LATEST_S = 1e10
"""A time in s is less for centuries; a larger one was written in ms or ns."""

Row = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """When a picture was taken, and of which pose of the board."""

    time_s: float | None = None
    pose_id: str | None = None
    """The label in the column view, which the pictures of a burst share."""


def read_table(path: Path) -> list[dict[str, str]]:
    """The rows of a frames.csv, without one that a kill left without its end; none where there is
    no such file.
    """
    with reading(path):
        if not path.exists():
            return []
    data = read_file(path, MOST_TEXT)
    if _is_recorded(data):  # tables by hand often lack the last line break
        data = data[: data.rfind(b"\n") + 1]
    try:
        text = data.decode("utf-8-sig")
        rows = list(csv.DictReader(io.StringIO(text, newline=""), restval="", strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"{path} is not a CSV table in UTF-8 ({brief(error)}): mend it, or move it elsewhere."
        ) from error
    if any("file" not in row or None in row for row in rows):
        raise InputError(
            f"{path} has no column file, or rows longer than its first: its first line must be"
            f" {','.join(FIXED)},..."
        )
    return rows


def is_by_hand(path: Path) -> bool:
    """True if a table is there that no recorder began."""
    with reading(path):
        return path.exists() and not _is_recorded(read_file(path, MOST_TEXT))


def _is_recorded(data: bytes) -> bool:
    return data.startswith(",".join(FIXED).encode())


def read_frame_records(path: Path) -> dict[str, FrameRecord]:
    """By picture, without its folder; pictures without a row are not in it, and an empty cell says
    nothing.

    Raises:
        InputError: it is no table, or a time is not one.
    """
    records = {}
    for row in read_table(path):
        time_s = recorded_time(row)
        if time_s is None and row.get("time_s", "").strip():
            raise InputError(
                f"{path}: time_s of {brief(row['file'])} is {brief(row['time_s'])!r}: write"
                f" seconds, such as 12.5, less than {LATEST_S:g}, or leave it empty."
            )
        records[Path(row["file"]).name] = FrameRecord(time_s, row.get("view", "").strip() or None)
    return records


def recorded_time(row: Row) -> float | None:
    """s; None where the row has no time, or one that no clock shows."""
    try:
        time_s = float(row["time_s"])
    except (KeyError, ValueError):
        return None
    return time_s if abs(time_s) < LATEST_S else None


def mended(rows: Sequence[Row], pictures: Sequence[Path]) -> list[Row]:
    """A row for each picture, in the rows' order and then the pictures': those without one get a
    row that only names them.
    """
    names = {picture.name for picture in pictures}
    kept = [row for row in rows if row["file"] in names]
    known = {row["file"] for row in kept}
    return kept + [{"file": picture.name} for picture in pictures if picture.name not in known]


def columns(rows: Sequence[Row], more: Sequence[str] = ()) -> list[str]:
    """Every column of the rows, and others, each once."""
    return list(dict.fromkeys((*FIXED, *(key for row in rows for key in row), *more)))


def to_csv(rows: Sequence[Row], keys: Sequence[str], *, header: bool = True) -> str:
    """Lines of the table; a cell holds no line break, so that a line without its end is a row
    without its end.
    """
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, keys, restval="", lineterminator="\n")
    if header:
        writer.writeheader()
    writer.writerows({key: " ".join(cell.split()) for key, cell in row.items()} for row in rows)
    return text.getvalue()


def last_view(rows: Sequence[Row]) -> int:
    """The highest number of a view so far; -1 if there is none."""
    return max(
        (number for row in rows if (number := whole_number(row.get("view", ""))) is not None),
        default=-1,
    )

"""The table frames.csv: one row for each picture, with its time and the camera's metadata.

A row is appended only after its picture is on the disk. So a recording that is interrupted leaves
at worst an incomplete row, or a picture without a row. Both are repaired when the recording is
continued.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.errors import InputError, brief
from calib.io.files import MAX_TEXT_BYTES, read_file, reading
from calib.io.numerals import whole_number

NAME = "frames.csv"
FIXED = ("file", "time_s", "sequence", "view")
"""The columns that every recording has: the picture's name, Unix time in s, the driver's counter,
and the number of the board's pose, which the pictures of a burst share. The camera's metadata come
after them.
"""
LATEST_S = 1e10
"""Times in s will be less for centuries. A larger number was written in ms or ns."""

Row = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """The time of a picture, and the pose of the board that it shows."""

    time_s: float | None = None
    pose_id: str | None = None
    """The label in the column view, which the pictures of a burst share."""


def read_table(path: Path) -> list[dict[str, str]]:
    """Return the rows of a frames.csv, without an incomplete last row; none if the file does not
    exist.

    Raises:
        InputError: the file is not such a table, or has two different rows for one picture.
    """
    with reading(path):
        if not path.exists():
            return []
    data = read_file(path, MAX_TEXT_BYTES)
    if _is_recorded(data):  # handmade tables often lack the last line break
        data = data[: data.rfind(b"\n") + 1]
    try:
        text = data.decode("utf-8-sig")
        reader = csv.DictReader(io.StringIO(text, newline=""), restval="", strict=True)
        lines = [(reader.line_num, row) for row in reader]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"{path} is not a CSV table in UTF-8 ({brief(error)}): mend it, or move it elsewhere."
        ) from error
    if any("file" not in row or None in row for _, row in lines):
        raise InputError(
            f"{path} has no column file, or rows longer than its first: its first line must be"
            f" {','.join(FIXED)},..."
        )
    _check_unique(path, lines)
    return [row for _, row in lines]


def _check_unique(path: Path, lines: Sequence[tuple[int, Row]]) -> None:
    """Raise InputError if two different rows are of one picture. `lines` are the rows with the
    numbers of their lines, from 1.
    """
    first: dict[str, tuple[int, Row]] = {}
    for number, row in lines:
        name = Path(row["file"]).name
        earlier_number, earlier_row = first.setdefault(name, (number, row))
        if row != earlier_row:
            raise InputError(
                f"{path}: lines {earlier_number} and {number} are both of {brief(name)}, and they"
                " differ: remove one of them."
            )


def is_by_hand(path: Path) -> bool:
    """True if the table exists, and no recorder began it."""
    with reading(path):
        return path.exists() and not _is_recorded(read_file(path, MAX_TEXT_BYTES))


def _is_recorded(data: bytes) -> bool:
    return data.startswith(",".join(FIXED).encode())


def read_frame_records(path: Path) -> dict[str, FrameRecord]:
    """Return the records of a frames.csv by the picture's file name. Pictures without a row have no
    record, and an empty cell gives None.

    Raises:
        InputError: the file is not such a table, or a time is not a number of seconds.
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
    """Return the time of a row in s; None if it has none, or one that cannot be in seconds."""
    try:
        time_s = float(row["time_s"])
    except (KeyError, ValueError):
        return None
    return time_s if abs(time_s) < LATEST_S else None


def match_pictures(rows: Sequence[Row], pictures: Sequence[Path]) -> list[Row]:
    """Return a row for each picture: first the rows of these pictures in their order, then a row
    with only the name for each picture that has none.
    """
    names = {picture.name for picture in pictures}
    matched = [row for row in rows if row["file"] in names]
    recorded = {row["file"] for row in matched}
    return matched + [
        {"file": picture.name} for picture in pictures if picture.name not in recorded
    ]


def columns(rows: Sequence[Row], additional: Sequence[str] = ()) -> list[str]:
    """Return the fixed columns, those of the rows, and additional ones, each once."""
    return list(dict.fromkeys((*FIXED, *(key for row in rows for key in row), *additional)))


def to_csv(rows: Sequence[Row], keys: Sequence[str], *, header: bool = True) -> str:
    """Return lines of the table. Line breaks in cells become spaces, so every row is one line."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, keys, restval="", lineterminator="\n")
    if header:
        writer.writeheader()
    writer.writerows({key: " ".join(cell.split()) for key, cell in row.items()} for row in rows)
    return text.getvalue()


def last_view(rows: Sequence[Row]) -> int:
    """Return the highest number of a view; -1 if there is none."""
    return max(
        (number for row in rows if (number := whole_number(row.get("view", ""))) is not None),
        default=-1,
    )

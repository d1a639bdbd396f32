"""frames.csv has one row for each picture."""

from pathlib import Path

import pytest

from calib.errors import InputError
from calib.io.frames_table import read_frame_records, read_table


def test_two_rows_of_one_picture_are_refused_with_their_lines(tmp_path: Path) -> None:
    table = tmp_path / "frames.csv"
    table.write_text("file,time_s\n0000.png,1\n0001.png,2\n\nframes/0000.png,7\n")
    message = r"frames.csv: lines 2 and 5 are both of 0000.png, and they differ: remove one"
    with pytest.raises(InputError, match=message):
        read_frame_records(table)


def test_a_row_that_stands_twice_counts_once(tmp_path: Path) -> None:
    table = tmp_path / "frames.csv"
    table.write_text("file,time_s\n0000.png,1\n0000.png,1\n")
    assert {name: record.time_s for name, record in read_frame_records(table).items()} == {
        "0000.png": 1.0
    }
    assert len(read_table(table)) == 2

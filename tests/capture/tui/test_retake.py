"""Views without the cover that are set aside, to be taken again."""

from pathlib import Path

import pytest

from calib.errors import InputError
from capture.disk import locked
from capture.tui.retake import set_bare_aside


def test_all_files_of_a_folder_are_moved_and_none_is_overwritten(tmp_path: Path) -> None:
    for words, place in (("first", "bare-aside"), ("second", "bare-aside-1")):
        (tmp_path / "bare").mkdir()
        (tmp_path / "bare" / "frames.csv").write_text(words)
        assert set_bare_aside(tmp_path) == tmp_path / place
        assert not (tmp_path / "bare").exists()
        assert (tmp_path / place / "frames.csv").read_text() == words
    assert (tmp_path / "bare-aside" / "frames.csv").read_text() == "first"


def test_a_folder_in_use_by_a_recorder_is_not_moved(tmp_path: Path) -> None:
    (tmp_path / "bare").mkdir()
    with locked(tmp_path), pytest.raises(InputError, match="Another recorder"):
        set_bare_aside(tmp_path)
    assert (tmp_path / "bare").is_dir()


def test_a_missing_folder_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="bare cannot be written"):
        set_bare_aside(tmp_path)

"""The files of a folder change as one: whoever was killed, whoever else writes, whatever a stranger
left there.
"""

import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from calib.errors import InputError
from calib.io.file_set import MOST_OPEN, REMOVED, UNFINISHED, WHOLE, FileSet, in_force, settle

OLD = {"a": "old a", "b": "old b", "gone_1": "old", "kept": "by hand"}
NEW = {"a": "new a", "b": "new b", "c": "new c", "kept": "by hand"}
WRITER = """
import sys
from pathlib import Path
from calib.io.file_set import FileSet
from tests.io.killed import kill_at

folder = Path(sys.argv[1])
kill_at(int(sys.argv[2]), folder)
with FileSet(folder) as files:
    for name in "abc":
        files.write(name, f"new {name}")
    files.commit(instead_of=["gone_*"])
"""


def fill(folder: Path) -> Path:
    folder.mkdir()
    for name, text in OLD.items():
        (folder / name).write_text(text)
    return folder


def contents(folder: Path) -> dict[str, str]:
    return {
        path.name: path.read_text() if path.is_file() else "a folder" for path in folder.iterdir()
    }


def test_a_writer_killed_at_any_change_leaves_the_old_set_or_the_new_one(tmp_path: Path) -> None:
    found = []
    for change in range(100):
        folder = fill(tmp_path / str(change))
        ended = subprocess.run(
            [sys.executable, "-c", WRITER, str(folder), str(change)], check=False
        ).returncode
        names = set(contents(folder))
        if WHOLE not in names:
            assert names - {UNFINISHED} in (
                OLD.keys(),
                NEW.keys(),
            ), "what is neither in force nor a place is hidden in one folder"
        assert in_force(folder / "a").read_text() in ("old a", "new a")
        found.append(contents(folder))
        assert found[-1] in (OLD, NEW), f"killed at change {change}"
        if ended == 0:
            break
        assert ended == -signal.SIGKILL
    assert found[-1] == NEW
    turned = found.index(NEW)
    assert found == [OLD] * turned + [NEW] * (len(found) - turned)
    assert turned >= 5, (
        "there are as many changes before the new set is in force as there are files"
    )
    assert len(found) - turned >= 5, "and as many after it"


def test_what_is_not_put_in_force_changes_nothing(tmp_path: Path) -> None:
    folder = fill(tmp_path / "out")
    with FileSet(folder) as files:
        for number in range(MOST_OPEN + 20):
            files.write(str(number), "")
        files.write("a", "new")
    assert contents(folder) == OLD


def test_more_files_than_may_be_open(tmp_path: Path) -> None:
    names = {str(number) for number in range(2 * MOST_OPEN + 1)}
    with FileSet(tmp_path) as files:
        for name in names:
            files.write(name, "first")
        for name in names:
            files.write(name, "second")
        files.commit()
    assert contents(tmp_path) == dict.fromkeys(names, "second")


@pytest.mark.parametrize("without", ["O_TMPFILE", "proc"])
def test_a_disk_without_unnamed_files(
    without: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if without == "proc":
        monkeypatch.setattr("calib.io.files.OPEN_FILES", tmp_path / "no")
    else:
        monkeypatch.delattr(os, "O_TMPFILE")
    folder = fill(tmp_path / "out")
    with FileSet(folder) as files:
        files.write("a", "new a")
    assert contents(folder) == OLD
    with FileSet(folder) as files:
        for name in "abc":
            files.write(name, f"new {name}")
        files.commit(instead_of=["gone_*"])
    assert contents(folder) == NEW


def test_one_writer_at_a_time(tmp_path: Path) -> None:
    with FileSet(tmp_path) as files:
        with (
            pytest.raises(InputError, match=r"Another calib writes to .*: wait until it has ended"),
            FileSet(tmp_path),
        ):
            pass
        files.write("a", "")
        files.commit()
    with FileSet(tmp_path):
        pass


def test_a_disk_without_locks_of_folders_is_written_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", refuse)
    with FileSet(tmp_path) as files:
        files.write("a", "new")
        files.commit()
    assert contents(tmp_path) == {"a": "new"}


def test_a_full_disk_leaves_the_old_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = fill(tmp_path / "out")

    def fail(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with FileSet(folder) as files:
        files.write("a", "new")
        monkeypatch.setattr("os.fsync", fail)
        with pytest.raises(InputError, match="free some space"):
            files.commit()
    assert contents(folder) == OLD


def test_a_reader_who_may_not_write_reads_the_set_in_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of a disk that can only be read: what was not moved to its place is read where it is."""
    folder = fill(tmp_path / "out")
    (folder / WHOLE).mkdir()
    (folder / WHOLE / "a").write_text("new a")
    monkeypatch.setattr(
        "calib.io.file_set._locked",
        lambda _: (_ for _ in ()).throw(PermissionError(errno.EACCES, "no")),
    )
    monkeypatch.setattr("os.access", lambda *_: False)
    assert in_force(folder / "a").read_text() == "new a"
    assert in_force(folder / "b").read_text() == "old b"


def test_a_strangers_hidden_folders_reach_nothing_outside(tmp_path: Path) -> None:
    """Not by a link, and not by a list of what to remove."""
    victim, folder = fill(tmp_path / "victim"), fill(tmp_path / "out")
    for name in (WHOLE, UNFINISHED):
        (folder / name).symlink_to(victim)
        settle(folder)
        assert in_force(folder / "a").read_text() == "old a"
    assert contents(victim) == contents(folder) == OLD
    for said in (["../victim/a", "..", ".", "", 5, None, "gone_1/../../victim/b"], {"a": 1}, "a"):
        (folder / WHOLE).mkdir()
        (folder / WHOLE / REMOVED).write_text(json.dumps(said))
        settle(folder)
        assert contents(victim) == contents(folder) == OLD


def test_a_name_that_a_folder_has(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with (
        FileSet(tmp_path) as files,
        pytest.raises(
            InputError, match=r"a cannot be written .*: choose a name that no folder has"
        ),
    ):
        files.write("a", "")

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
from calib.io.file_set import (
    CURRENT,
    HIDDEN,
    MAX_OPEN_FILES,
    NEW,
    FileSet,
    find_current,
    finish_change,
)
from calib.io.output_folder import LEDGER, Content, OutputFolder

OLD = {"a": "old a", "b": "old b", "gone_1": "old", "kept": "by hand"}
NEW_SET = {"a": "new a", "b": "new b", "c": "new c", "kept": "by hand"}
WRITER = """
import errno, os, sys
from pathlib import Path
from calib.io.file_set import FileSet
from tests.io.killed import kill_at

folder = Path(sys.argv[1])
if sys.argv[3] == "no links":
    def refuse(*_, **__):
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    os.symlink = os.link = refuse
    del os.O_TMPFILE
kill_at(int(sys.argv[2]), folder)
with FileSet(folder) as files:
    for name in "abc":
        files.write(name, f"new {name}")
    files.commit(instead_of=["gone_*"])
"""


def fill(folder: Path) -> Path:
    """A folder whose files are ours, but for the one that somebody made by hand."""
    folder.mkdir()
    for name, text in OLD.items():
        (folder / name).write_text(text)
    OutputFolder(folder).add({name: Content.of(OLD[name]) for name in OLD if name != "kept"})
    return folder


def contents(folder: Path) -> dict[str, str]:
    """Return the files that any program sees, without hidden ones: a link that leads nowhere is no
    file.
    """
    return {
        path.name: path.read_text() if path.is_file() else "a folder"
        for path in folder.iterdir()
        if path.exists() and not path.name.startswith(".")
    }


@pytest.mark.parametrize("disk", ["links", pytest.param("no links", marks=pytest.mark.slow)])
def test_a_writer_killed_at_any_change_leaves_the_old_set_or_the_new_one(
    disk: str, tmp_path: Path
) -> None:
    results = []
    for change in range(100):
        folder = fill(tmp_path / str(change))
        ended = subprocess.run(
            [sys.executable, "-c", WRITER, str(folder), str(change), disk], check=False
        ).returncode
        content = contents(folder)
        if disk == "links":
            assert content in (OLD, NEW_SET), (
                "any program sees one whole set, before calib tidies up"
            )
        assert find_current(folder / "a").read_text() in ("old a", "new a")
        results.append(contents(folder))
        assert results[-1] in (OLD, NEW_SET), f"killed at change {change}"
        assert disk == "no links" or results[-1] == content
        assert not (folder / HIDDEN).exists()
        assert not any(path.is_symlink() for path in folder.iterdir())
        if ended == 0:
            break
        assert ended == -signal.SIGKILL
    assert results[-1] == NEW_SET
    turned = results.index(NEW_SET)
    assert results == [OLD] * turned + [NEW_SET] * (len(results) - turned)
    assert turned >= 5, (
        "there are as many changes before the new set is in force as there are files"
    )
    assert len(results) - turned >= 5, "and as many after it"


def test_a_set_that_is_not_committed_changes_nothing(tmp_path: Path) -> None:
    folder = fill(tmp_path / "out")
    with FileSet(folder) as files:
        for number in range(MAX_OPEN_FILES + 20):
            files.write(str(number), "")
        files.write("a", "new")
    assert contents(folder) == OLD


def test_a_folder_that_was_made_for_nothing_is_removed(tmp_path: Path) -> None:
    folder = tmp_path / "calibration"
    with FileSet(folder) as files:
        files.write("a.txt", "lost")  # and not committed
    assert not folder.exists()
    folder.mkdir()
    with FileSet(folder):
        pass
    assert folder.exists(), "somebody else made it"
    folder.rmdir()
    with FileSet(folder) as files:
        (folder / "theirs.txt").write_text("kept")
    assert (folder / "theirs.txt").read_text() == "kept"


def test_a_set_may_have_more_files_than_may_be_open(tmp_path: Path) -> None:
    names = {str(number) for number in range(2 * MAX_OPEN_FILES + 1)}
    with FileSet(tmp_path) as files:
        for name in names:
            files.write(name, "first")
        for name in names:
            files.write(name, "second")
        files.commit()
    assert contents(tmp_path) == dict.fromkeys(names, "second")


@pytest.mark.parametrize("without", ["O_TMPFILE", "proc"])
def test_a_disk_without_unnamed_files_is_written_to(
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
    assert contents(folder) == NEW_SET


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
    """On a disk without links that can only be read, a file that was not moved is read in place."""
    folder = fill(tmp_path / "out")
    (folder / HIDDEN / NEW).mkdir(parents=True)
    (folder / HIDDEN / NEW / "a").write_text("new a")
    (folder / HIDDEN / CURRENT).write_text("{}")
    monkeypatch.setattr(
        "calib.io.file_set.lock_folder",
        lambda _: (_ for _ in ()).throw(PermissionError(errno.EACCES, "no")),
    )
    monkeypatch.setattr("os.access", lambda *_: False)
    assert find_current(folder / "a").read_text() == "new a"
    assert find_current(folder / "b").read_text() == "old b"


def test_a_strangers_hidden_folders_reach_nothing_outside(tmp_path: Path) -> None:
    """Not by a link, and not by a list of what to remove."""
    victim, folder = fill(tmp_path / "victim"), fill(tmp_path / "out")
    (folder / HIDDEN).symlink_to(victim)
    finish_change(folder)
    assert find_current(folder / "a").read_text() == "old a"
    with pytest.raises(InputError, match="in the way, and calib did not make it"), FileSet(folder):
        pass
    (folder / HIDDEN).unlink()
    (folder / HIDDEN).mkdir()
    (folder / HIDDEN / NEW).symlink_to(victim)
    for current in (NEW, ".", "../victim", str(victim)):
        (folder / HIDDEN / CURRENT).symlink_to(current)
        finish_change(folder)
        assert find_current(folder / "a").read_text() == "old a"
        (folder / HIDDEN / CURRENT).unlink()
    assert contents(victim) == contents(folder) == OLD
    (folder / HIDDEN / NEW).unlink()
    (folder / HIDDEN).rmdir()
    entry = {"size": 5, "sha256": Content.of("old a").sha256, "removed": True}
    names = ("../victim/a", "..", ".", "", "a/../../victim/b")
    for decision in (dict.fromkeys(names, entry), ["a"], {"a": 1}, "a"):
        (folder / HIDDEN / NEW).mkdir(parents=True)
        (folder / HIDDEN / CURRENT).write_text(json.dumps(decision))
        finish_change(folder)
        assert contents(victim) == contents(folder) == OLD
        assert not (folder / HIDDEN).exists()


def test_a_foreign_file_is_refused_before_and_at_the_end(tmp_path: Path) -> None:
    folder = fill(tmp_path / "out")
    with FileSet(folder) as files:
        with pytest.raises(InputError, match=r"out/kept is not calib's own: .* --overwrite"):
            files.reserve(["a", "kept"])
        with pytest.raises(InputError, match="kept is not calib's own"):
            files.write("kept", "new")
        files.write("a", "new a")
        (folder / "a").write_text("edited")
        with pytest.raises(InputError, match="a has changed since calib wrote it"):
            files.commit(instead_of=["*"])
    assert contents(folder) == OLD | {"a": "edited"}
    with FileSet(folder, overwrite=True) as files:
        files.write("a", "new a")
        files.commit(instead_of=["*"])
    assert contents(folder) == {"a": "new a", "kept": "by hand"}, (
        "what is ours is removed, a foreign file stays"
    )


def test_an_old_file_that_somebody_changed_is_not_removed(tmp_path: Path) -> None:
    folder = fill(tmp_path / "out")
    (folder / "gone_1").write_text("edited")
    with FileSet(folder) as files:
        files.write("a", "new a")
        files.commit(instead_of=["gone_*"])
    assert contents(folder) == OLD | {"gone_1": "edited", "a": "new a"}
    assert LEDGER in {path.name for path in folder.iterdir()}


def test_a_name_that_a_folder_has(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with FileSet(tmp_path) as files, pytest.raises(InputError, match="a is a folder, and"):
        files.write("a", "")

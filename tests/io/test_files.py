"""A write that fails leaves things as they were."""

import errno
import os
import tracemalloc
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from calib.errors import InputError
from calib.io.files import READ_SIZE, npz, read_file, write_atomically


def test_text_and_bytes_are_written(tmp_path: Path) -> None:
    write_atomically(tmp_path / "a", "grün\n")
    assert (tmp_path / "a").read_bytes() == "grün\n".encode()
    write_atomically(tmp_path / "a", b"\r\n\0")
    assert (tmp_path / "a").read_bytes() == b"\r\n\0"
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_file_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    write_atomically(tmp_path / "a", "")
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize(
    ("code", "advice"),
    [
        (errno.ENOSPC, "free some space"),
        (errno.EROFS, "disk that can be written"),
        (errno.EIO, "choose another place"),
    ],
    ids=errno.errorcode.get,
)
def test_failing_disk_leaves_the_old_file(
    code: int, advice: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: int) -> None:
        raise OSError(code, os.strerror(code))

    (tmp_path / "a").write_text("old")
    monkeypatch.setattr("calib.io.files.fsync", fail)
    with pytest.raises(
        InputError, match=rf"a cannot be written \({os.strerror(code)}\): .*{advice}"
    ):
        write_atomically(tmp_path / "a", "new")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


def test_interrupted_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    (tmp_path / "a").write_text("old")
    monkeypatch.setattr("calib.io.files.fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(tmp_path / "a", "new")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match="make its folder first"):
        write_atomically(tmp_path / "gone" / "a", "")
    with pytest.raises(InputError, match="inside a folder"):
        write_atomically(tmp_path / "file" / "a", "")
    with pytest.raises(InputError, match="a name that no folder has"):
        write_atomically(tmp_path / "folder", "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]


def test_a_small_file_is_read_in_little_memory(tmp_path: Path) -> None:
    """A machine with 1 GB cannot give 2 GB, however little of it is used."""
    path = tmp_path / "small"
    path.write_bytes(b"x" * 3 * READ_SIZE)
    tracemalloc.start()
    try:
        assert read_file(path) == b"x" * 3 * READ_SIZE
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 8 * READ_SIZE, "the bytes, a piece, and room to grow"


@pytest.mark.parametrize("limit", [0, 1, READ_SIZE, READ_SIZE + 1, 2 * READ_SIZE])
def test_a_file_may_be_as_large_as_the_limit_and_no_larger(tmp_path: Path, limit: int) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x" * limit)
    assert len(read_file(path, limit)) == limit
    path.write_bytes(b"x" * (limit + 1))
    with pytest.raises(InputError, match="is larger than the"):
        read_file(path, limit)


def test_arrays_come_back() -> None:
    arrays = {
        "a.b": np.arange(6.0).reshape(2, 3),
        "empty": np.zeros((0, 2)),
        "flag": np.array(True),
    }
    with np.load(BytesIO(npz(arrays)), allow_pickle=False) as loaded:
        assert set(loaded) == set(arrays)
        for name, array in arrays.items():
            np.testing.assert_array_equal(loaded[name], array)


def test_objects_are_not_pickled() -> None:
    with pytest.raises(TypeError, match="cannot be saved: a"):
        npz({"a": np.array([None])})

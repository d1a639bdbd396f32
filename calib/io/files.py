"""Files that a person named: what fails is a sentence, and a reader finds the old file or the new
one, never half of it.
"""

import errno
import os
import secrets
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from io import BytesIO
from os import fsync
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError

ADVICE = {
    errno.ENOSPC: "free some space there, or choose another disk",
    errno.EDQUOT: "free some space there, or choose another disk",
    errno.EROFS: "choose a folder on a disk that can be written",
    errno.EACCES: "choose another folder, or change the permissions of this one",
    errno.EPERM: "choose another folder, or change the permissions of this one",
    errno.ENOENT: "make its folder first",
    errno.ENOTDIR: "choose a place inside a folder",
    errno.EISDIR: "choose a name that no folder has",
    errno.ENAMETOOLONG: "choose a shorter name",
}
"""What a person can do about a write that failed."""
MOST_TEXT = 16 << 20
"""Bytes of a table or a description: a larger one is something else."""
MOST_BYTES = 2 << 30
"""Bytes of a picture, or of arrays."""
PIECE = 1 << 20
"""Bytes that are read at a time."""
BINARY = getattr(os, "O_BINARY", 0)
"""Without it, Windows changes the ends of lines."""
OPEN_FILES = Path("/proc/self/fd")
"""Where Linux shows a process its open files; an unnamed one gets its name by way of it."""


class Written:
    """Data on the disk of a folder, without a name there until it is given one: what ends before
    that, even by a kill, leaves nothing.

    A disk that has no files without a name gives it one that begins with a dot and ends with .tmp.
    """

    def __init__(self, folder: Path, data: bytes | memoryview | str) -> None:
        """Text as UTF-8, a byte of a file name that is none as its escape; OSError where it cannot
        be written.
        """
        self._temporary: Path | None = None
        try:
            if not OPEN_FILES.is_dir():
                raise OSError(errno.ENOTSUP, "no way to name an unnamed file")
            self._handle = os.open(folder, os.O_TMPFILE | os.O_WRONLY, 0o666)
        except (OSError, AttributeError):  # of old disks, and of other systems than Linux
            self._temporary = folder / f".refracal-{secrets.token_hex(8)}.tmp"
            self._handle = os.open(
                self._temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY | BINARY, 0o666
            )
        try:
            with open(self._handle, "wb", closefd=False) as file:
                file.write(
                    data.encode(errors="backslashreplace") if isinstance(data, str) else data
                )
            fsync(self._handle)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def name(self, path: Path) -> None:
        """Give it the name of a path of the same disk, where nothing is yet; OSError where that
        cannot be.
        """
        if self._temporary:
            self._temporary.rename(path)
            self._temporary = None
            return
        folder = os.open(
            path.parent, os.O_RDONLY | os.O_DIRECTORY
        )  # with a folder's handle, Python's link follows what /proc shows
        try:
            os.link(
                OPEN_FILES / str(self._handle),
                path.name,
                src_dir_fd=folder,
                dst_dir_fd=folder,
                follow_symlinks=True,
            )
        finally:
            os.close(folder)

    def close(self) -> None:
        """Let go of it; without a name, it is gone."""
        os.close(self._handle)
        if self._temporary:
            with suppress(OSError):
                self._temporary.unlink()


def write_atomically(path: Path, data: bytes | memoryview | str) -> None:
    """Write a file, text as UTF-8.

    When that fails, an InputError says what to do, and a file that was there is still whole.
    """
    temporary = path.with_name(f".refracal-{secrets.token_hex(8)}.tmp")
    try:
        with Written(path.parent, data) as written:
            written.name(temporary)
        temporary.replace(path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Around what only looks at a path: an OSError becomes the sentence of a path that cannot be
    read.

    From Python 3.14 on, `Path.exists` and its like take what cannot be looked up for what is not
    there, so it is looked up here as well.
    """
    try:
        with suppress(FileNotFoundError, NotADirectoryError):
            path.stat()
        yield
    except OSError as error:
        raise InputError(
            f"{error.filename or path} cannot be read ({error.strerror}): check its name and"
            " permissions."
        ) from error


def read_file(path: Path, most: int = MOST_BYTES) -> bytes:
    """The bytes of a regular file, of `most` at most.

    Raises:
        InputError: it cannot be read, is too large, or is something else, such as a pipe that would
            never end.
    """
    with reading(path):
        handle = os.open(
            path, os.O_RDONLY | BINARY | getattr(os, "O_NONBLOCK", 0)
        )  # a pipe without a writer is opened at once
        try:
            check_regular(path, os.fstat(handle).st_mode)
            with open(handle, "rb", closefd=False) as file:
                data = _up_to(file, most + 1)
        finally:
            os.close(handle)
    if len(data) > most:
        raise InputError(
            f"{path} is larger than the {_size(most)} that such a file may have: give another."
        )
    return data


def _up_to(file: BinaryIO, most: int) -> bytes:
    """All that a file has, but so many bytes at most.

    Python's read(most) takes that much memory before it sees how much there is.
    """
    held = BytesIO()
    while (left := most - held.tell()) and (piece := file.read(min(left, PIECE))):
        held.write(piece)
    return held.getvalue()


def check_regular(path: Path, mode: int | None = None) -> None:
    """InputError where a path is of something else than a file, or of nothing; `mode` is what the
    system says of it, if that was asked.
    """
    with reading(path):
        mode = path.stat().st_mode if mode is None else mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(mode):
        raise InputError(
            f"{path} is not a file but a pipe or a device: copy what it gives into a file, and give"
            " that."
        )


def _size(count: int) -> str:
    return f"{count >> 30} GB" if count >= 1 << 30 else f"{count >> 20} MB"


def make_folder(folder: Path) -> None:
    """Make a folder for results, and those above it; one that exists is fine."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder} cannot be made ({error.strerror}): choose another folder with -o."
        ) from error


def check_writable(folder: Path) -> None:
    """Make a folder for results and write there for a trial, so that long work is not lost at its
    end.
    """
    make_folder(folder)
    try:
        Written(folder, b"trial").close()
    except OSError as error:
        raise unwritable(folder, error) from error


def npz(arrays: Mapping[str, NDArray], *, compressed: bool = True) -> memoryview:
    """A file of named arrays, never pickled. Large maps are made much faster if not compressed."""
    pickled = [name for name, array in arrays.items() if array.dtype.hasobject]
    if pickled:
        raise TypeError(f"arrays of Python objects cannot be saved: {', '.join(pickled)}")
    buffer = BytesIO()
    (np.savez_compressed if compressed else np.savez)(buffer, allow_pickle=False, **arrays)
    return buffer.getbuffer()


def unwritable(path: Path, error: OSError) -> InputError:
    """What to say where a path could not be written."""
    return InputError(
        f"{path} cannot be written ({error.strerror}):"
        f" {ADVICE.get(error.errno or 0, 'choose another place')}."
    )

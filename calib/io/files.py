"""Read and write files that a person named. Failures become sentences. A reader finds the old file
or the new one, never half of it.
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
"""The advice for each error of a write."""
MAX_TEXT_BYTES = 16 << 20
"""The largest size of a table or a description, bytes: a larger file is something else."""
MAX_FILE_BYTES = 2 << 30
"""The largest size of a file of a picture or of arrays, bytes."""
READ_SIZE = 1 << 20
"""The number of bytes that are read at a time."""
BINARY = getattr(os, "O_BINARY", 0)
"""The flag without which Windows changes the ends of lines."""
OPEN_FILES = Path("/proc/self/fd")
"""The folder in which Linux shows a process its open files. An unnamed file gets its name through
it.
"""


class UnnamedFile:
    """A file with data on the disk of a folder that has no name until `name` gives it one. A
    process that ends before that, even by a kill, leaves nothing.

    On a disk that cannot have unnamed files, its name begins with a dot and ends with .tmp.
    """

    def __init__(self, folder: Path, data: bytes | memoryview | str) -> None:
        """Write the data, text as UTF-8; OSError if that fails. A text may hold a file name whose
        bytes are not UTF-8: such a byte is written as its escape.
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
        """Give the file a path on the same disk that does not exist yet; OSError if that fails."""
        if self._temporary:
            self._temporary.rename(path)
            self._temporary = None
            return
        # with a folder's handle, Python's link follows the links in /proc
        folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
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
        """Close the file. Without a name, it is removed."""
        os.close(self._handle)
        if self._temporary:
            with suppress(OSError):
                self._temporary.unlink()


def write_atomically(path: Path, data: bytes | memoryview | str) -> None:
    """Write a file, text as UTF-8.

    Raises:
        InputError: the file cannot be written. An existing file is unchanged.
    """
    temporary = path.with_name(f".refracal-{secrets.token_hex(8)}.tmp")
    try:
        with UnnamedFile(path.parent, data) as unnamed:
            unnamed.name(temporary)
        temporary.replace(path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """A context for code that only reads a path: an OSError becomes the InputError of a path that
    cannot be read.

    From Python 3.14 on, `Path.exists` and its like return False for a path that cannot be looked
    up, so this context looks it up, too.
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


def read_file(path: Path, limit: int = MAX_FILE_BYTES) -> bytes:
    """Return the bytes of a regular file.

    Raises:
        InputError: the file cannot be read, has more than `limit` bytes, or is something else, such
            as a pipe that would never end.
    """
    with reading(path):
        # O_NONBLOCK: a pipe without a writer is opened at once
        handle = os.open(path, os.O_RDONLY | BINARY | getattr(os, "O_NONBLOCK", 0))
        try:
            check_regular(path, os.fstat(handle).st_mode)
            with open(handle, "rb", closefd=False) as file:
                data = _read_up_to(file, limit + 1)
        finally:
            os.close(handle)
    if len(data) > limit:
        raise InputError(
            f"{path} is larger than the {_size_text(limit)} that such a file may have: give"
            " another."
        )
    return data


def _read_up_to(file: BinaryIO, limit: int) -> bytes:
    """Return the bytes of a file up to a limit.

    Python's read(limit) allocates that much memory before it knows the file's length.
    """
    content = BytesIO()
    while (remaining := limit - content.tell()) and (piece := file.read(min(remaining, READ_SIZE))):
        content.write(piece)
    return content.getvalue()


def check_regular(path: Path, mode: int | None = None) -> None:
    """Raise InputError if a path does not exist, or is not a regular file.

    Args:
        mode: the mode of the path from `os.stat`, if it is available.
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


def _size_text(count: int) -> str:
    return f"{count >> 30} GB" if count >= 1 << 30 else f"{count >> 20} MB"


def make_folder(folder: Path) -> None:
    """Make a folder for results, and its parents, unless they exist; InputError if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder} cannot be made ({error.strerror}): choose another folder with -o."
        ) from error


def check_writable(folder: Path) -> None:
    """Make a folder for results and write a file there as a trial, so that long work is not lost at
    its end; InputError if that fails.
    """
    make_folder(folder)
    try:
        UnnamedFile(folder, b"trial").close()
    except OSError as error:
        raise unwritable(folder, error) from error


def npz(arrays: Mapping[str, NDArray], *, compressed: bool = True) -> memoryview:
    """Return the bytes of a .npz file of named arrays, without pickles. Large maps are encoded much
    faster without compression.
    """
    object_names = [name for name, array in arrays.items() if array.dtype.hasobject]
    if object_names:
        raise TypeError(f"arrays of Python objects cannot be saved: {', '.join(object_names)}")
    buffer = BytesIO()
    (np.savez_compressed if compressed else np.savez)(buffer, allow_pickle=False, **arrays)
    return buffer.getbuffer()


def unwritable(path: Path, error: OSError) -> InputError:
    """Return the error of a path that could not be written, with advice."""
    return InputError(
        f"{path} cannot be written ({error.strerror}):"
        f" {ADVICE.get(error.errno or 0, 'choose another place')}."
    )

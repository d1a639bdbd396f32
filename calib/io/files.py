"""Files that a person named: what fails is a sentence, and a reader finds the old file or the new one, never half of it."""

import errno
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from hashlib import sha256
from io import BytesIO
from os import fsync
from pathlib import Path
from tempfile import NamedTemporaryFile

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


def write_atomically(path: Path, data: bytes | memoryview | str) -> None:
    """Write a file, text as UTF-8. When that fails, an InputError says what to do, and a file that was there is still whole."""
    temporary = path.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        with temporary.open("xb") as file:
            file.write(data.encode() if isinstance(data, str) else data)
            file.flush()
            fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Around what only looks at a path: an OSError becomes the sentence of a path that cannot be read."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{error.filename or path} cannot be read ({error.strerror}): check its name and permissions.") from error


def make_folder(folder: Path) -> None:
    """Make a folder for results, and those above it; one that exists is fine."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder} cannot be made ({error.strerror}): choose another folder with -o.") from error


def check_writable(folder: Path) -> None:
    """Make a folder for results and write there for a trial, so that long work is not lost at its end."""
    make_folder(folder)
    try:
        with NamedTemporaryFile(dir=folder, prefix=".", suffix=".tmp") as trial:
            trial.write(b"trial")
            trial.flush()
    except OSError as error:
        raise _unwritable(folder, error) from error


def save_npz(path: Path, arrays: Mapping[str, NDArray], *, compressed: bool = True) -> str:
    """Write named arrays, never pickled, and return the file's SHA-256. Large maps are written much faster if not compressed."""
    pickled = [name for name, array in arrays.items() if array.dtype.hasobject]
    if pickled:
        raise TypeError(f"arrays of Python objects cannot be saved: {', '.join(pickled)}")
    buffer = BytesIO()
    (np.savez_compressed if compressed else np.savez)(buffer, allow_pickle=False, **arrays)
    write_atomically(path, buffer.getbuffer())
    return sha256(buffer.getbuffer()).hexdigest()


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(f"{path} cannot be written ({error.strerror}): {ADVICE.get(error.errno or 0, 'choose another place')}.")

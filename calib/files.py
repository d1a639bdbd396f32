"""Writing so that a reader finds the old file or the new one, never half of it."""

import errno
import secrets
from collections.abc import Mapping
from contextlib import suppress
from io import BytesIO
from os import fsync
from pathlib import Path

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
        advice = ADVICE.get(error.errno or 0, "choose another place")
        raise InputError(f"{path} cannot be written ({error.strerror}): {advice}.") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def make_folder(folder: Path) -> None:
    """Make a folder for results, and those above it; one that exists is fine."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder} cannot be made ({error.strerror}): choose another folder with -o.") from error


def save_npz(path: Path, arrays: Mapping[str, NDArray], *, compressed: bool = True) -> None:
    """Write named arrays, never pickled. Large maps are written much faster if not compressed."""
    pickled = [name for name, array in arrays.items() if array.dtype.hasobject]
    if pickled:
        raise TypeError(f"arrays of Python objects cannot be saved: {', '.join(pickled)}")
    buffer = BytesIO()
    (np.savez_compressed if compressed else np.savez)(buffer, allow_pickle=False, **arrays)
    write_atomically(path, buffer.getbuffer())

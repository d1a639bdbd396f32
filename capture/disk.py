"""The disk that a recording writes to: a failure becomes a sentence, written data stays written,
and one recorder holds a folder.
"""

import errno
import fcntl
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from calib.errors import InputError, harmless
from calib.io.files import ADVICE
from calib.io.files import write_atomically as write_file
from capture.errors import CaptureError

DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""The errors of the disk itself. Any other error comes from the chosen place."""


def write_durably(path: Path, data: bytes | memoryview | str) -> None:
    """Write a complete file, and wait until the disk has both the file and its name."""
    with writing(path):
        write_file(path, data)
        sync_folder(path.parent)


def is_regular_file(path: Path) -> bool:
    """Return True for a file that is there itself: a link may lead anywhere."""
    return path.is_file() and not path.is_symlink()


def sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def append_durably(path: Path, line: str) -> None:
    """Add a line and wait until the disk has it. If that fails, the file stays as it was."""
    data = line.encode()
    with writing(path):
        handle = open_recorder_file(path, os.O_WRONLY | os.O_APPEND)
        try:
            size = os.fstat(handle).st_size
            try:
                # a full disk takes a piece only, and the next call then raises its error
                while data:
                    data = data[os.write(handle, data) :]
                os.fsync(handle)
            except OSError:
                os.ftruncate(handle, size)
                raise
        finally:
            os.close(handle)


def open_recorder_file(path: Path, flags: int) -> int:
    """Open one of the recorder's own files for changes in place, and return its handle.

    Raises:
        OSError: it cannot be opened.
        InputError: the path is a link: a session from a stranger may have a link there, to
            a file that nobody may touch.
    """
    foreign = InputError(
        f"{path} is a link or not a regular file, so the recorder cannot use it: remove it, or"
        " record elsewhere."
    )
    try:
        handle = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO):
            raise foreign from None  # `writing` would report the system call
        raise
    status = os.fstat(handle)
    if not stat.S_ISREG(status.st_mode) or status.st_nlink != 1:
        os.close(handle)
        raise foreign
    return handle


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Translate the errors of code that writes at a path: CaptureError where the disk fails,
    InputError where the place is wrong.
    """
    try:
        yield
    except (OSError, InputError) as error:
        cause = error if isinstance(error, OSError) else error.__cause__
        if not isinstance(cause, OSError):
            raise
        kind = CaptureError if cause.errno in DISK_ERRORS else InputError
        advice = ADVICE.get(cause.errno or 0, "choose another place")
        raise kind(f"{path} cannot be written ({cause.strerror}): {advice}.") from error


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder; InputError if another process holds it.

    The system releases it when this process ends, however it ends.
    """
    with writing(folder):
        handle = open_recorder_file(folder / ".recording", os.O_RDWR | os.O_CREAT)
    try:
        with writing(folder):
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                holder = (
                    harmless(os.pread(handle, 20, 0).decode(errors="replace").strip()) or "unknown"
                )
                raise InputError(
                    f"Another recorder (process {holder}) writes to {folder}: end it first, or"
                    " record elsewhere."
                ) from None
            before = os.pread(handle, 21, 0)
            if before and not re.fullmatch(rb"[0-9]{1,20}\n?", before):
                raise InputError(
                    f"{folder / '.recording'} is not a file of the recorder's own: remove it, or"
                    " record elsewhere."
                )
            os.ftruncate(handle, 0)
            os.pwrite(handle, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(handle)

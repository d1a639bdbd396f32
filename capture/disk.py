"""The disk that a recording goes to: what fails is a sentence, what is written stays written, and
one recorder holds a folder.
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
from calib.io.files import write_atomically as write_whole
from capture.errors import CaptureError

FAILED = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""What is the disk's own fault. Any other failure is of the place that was chosen."""


def write_durably(path: Path, data: bytes | memoryview | str) -> None:
    """Write a file as a whole, and wait until the disk has both it and its name."""
    with writing(path):
        write_whole(path, data)
        sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def append_durably(path: Path, line: str) -> None:
    """Add a line and wait until the disk has it. When that fails, the file is as it was."""
    data = line.encode()
    with writing(path):
        handle = open_own(path, os.O_WRONLY | os.O_APPEND)
        try:
            before = os.fstat(handle).st_size
            try:
                while data:  # where there is room for a part only, the rest says why
                    data = data[os.write(handle, data) :]
                os.fsync(handle)
            except OSError:
                os.ftruncate(handle, before)
                raise
        finally:
            os.close(handle)


def open_own(path: Path, flags: int) -> int:
    """The handle of a recorder's own file, opened to be changed in its place.

    Raises:
        OSError: it cannot be opened.
        InputError: it leads to something else: a session from a stranger may have a link there, to
            a file that is not to be touched.
    """
    elsewhere = InputError(
        f"{path} is not a file of the recorder's own but leads elsewhere: remove it, or record"
        " elsewhere."
    )
    try:
        handle = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO):
            raise elsewhere from None  # `writing` would tell of the system call
        raise
    found = os.fstat(handle)
    if not stat.S_ISREG(found.st_mode) or found.st_nlink != 1:
        os.close(handle)
        raise elsewhere
    return handle


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Around what writes at a path: CaptureError where the disk fails, InputError where the place
    is wrong.
    """
    try:
        yield
    except (OSError, InputError) as error:
        cause = error if isinstance(error, OSError) else error.__cause__
        if not isinstance(cause, OSError):
            raise
        kind = CaptureError if cause.errno in FAILED else InputError
        advice = ADVICE.get(cause.errno or 0, "choose another place")
        raise kind(f"{path} cannot be written ({cause.strerror}): {advice}.") from error


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder; InputError if another process does.

    The system lets go of it when this process ends, however it ends.
    """
    with writing(folder):
        handle = open_own(folder / ".recording", os.O_RDWR | os.O_CREAT)
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

"""The lock of an output folder. It ends with the process that holds it, however that ends."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from errno import EBADF, EINVAL, ENOLCK, ENOSYS, ENOTSUP
from pathlib import Path

from calib.errors import InputError
from calib.io.files import make_folder, unwritable

try:
    import fcntl
except ImportError:  # Windows: two writers at once are not noticed
    fcntl = None  # type: ignore[assignment]

UNSUPPORTED_ERRORS = (EBADF, ENOLCK, ENOTSUP, EINVAL, ENOSYS)
"""The errors of disks, such as network disks, that cannot lock or sync a folder."""


class BusyError(InputError):
    """The error of a folder to which another process writes."""


def lock_folder(folder: Path, announce_wait: Callable[[], None] | None = None) -> int | None:
    """Return a handle that locks the folder until it is closed or this process ends; None if the
    disk has no locks.

    Args:
        announce_wait: called if another process holds the folder, before this one waits for it.
            None: do not wait.

    Raises:
        BusyError: another process holds the folder, and this one does not wait.
        InputError: the folder cannot be opened or locked.
    """
    if fcntl is None:
        return None
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise unwritable(folder, error) from error
    try:
        _take(handle, announce_wait)
    except BlockingIOError:
        os.close(handle)
        raise BusyError(
            f"Another calib writes to {folder}: wait until it has ended, or choose another folder"
            " with -o."
        ) from None
    except OSError as error:
        os.close(handle)
        if error.errno in UNSUPPORTED_ERRORS:
            return None
        raise unwritable(folder, error) from error
    except BaseException:  # a person who does not want to wait
        os.close(handle)
        raise
    return handle


@contextmanager
def hold_folder(folder: Path, announce_wait: Callable[[], None]) -> Iterator[None]:
    """Hold an output folder, which is made if need be, after waiting for another process that holds
    it. A new folder that stays empty is removed.

    Raises:
        InputError: the folder cannot be made, opened or locked.
    """
    is_new = not os.path.lexists(folder)
    make_folder(folder)
    try:
        handle = lock_folder(folder, announce_wait)
        try:
            yield
        finally:
            if handle is not None:
                os.close(handle)
    finally:
        if is_new:
            with suppress(OSError):  # it has files
                folder.rmdir()


def _take(handle: int, announce_wait: Callable[[], None] | None) -> None:
    """Lock a folder by its handle; BlockingIOError if it is held and nobody waits."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        if announce_wait is None:
            raise
        announce_wait()
        fcntl.flock(handle, fcntl.LOCK_EX)

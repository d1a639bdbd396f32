"""The files of a folder that belong together change as one: whoever looks finds the old set or the
new one, however the writer ended.

What is written has no name until all of it is on the disk. Then it gets its names in the hidden
folder UNFINISHED, and renaming that to WHOLE puts it in force. From there the files go to their
places; where that was cut short, the next who reads or writes goes on with it, and a reader who may
not write reads from WHOLE. A folder has one writer at a time.
"""

import errno
import json
import os
import shutil
import time
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from calib.errors import InputError
from calib.io.files import Written, check_writable, make_folder, unwritable

try:
    import fcntl
except ImportError:  # Windows: two writers at once are not noticed
    fcntl = None  # type: ignore[assignment]

UNFINISHED = ".unfinished-set"
WHOLE = ".whole-set"
REMOVED = ".removed.json"
"""In the hidden folder: names of the set before that are not of this one."""
MOST_OPEN = 100
"""Files without a name, each of which is an open one; systems allow from 256."""
PATIENCE_S = 2.0
"""How long a reader waits for a writer who is moving files; that takes milliseconds."""
NOT_OF_FOLDERS = (errno.EBADF, errno.ENOLCK, errno.ENOTSUP, errno.EINVAL, errno.ENOSYS)
"""What network disks and others say that cannot lock a folder, or wait for one."""


class BusyError(InputError):
    """Another process writes to the folder."""


class FileSet:
    """Files for one folder, which is held from the `with` on; `commit` puts them in force, and
    without it nothing has changed.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._unnamed: dict[str, Written] = {}
        self._names: dict[str, None] = {}
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        """InputError where the folder cannot be made or written; BusyError where another process
        writes to it.
        """
        make_folder(self.folder)
        handle = _locked(self.folder)
        if handle is not None:
            self._stack.callback(os.close, handle)
        try:
            check_writable(self.folder)
            _settle(self.folder)
        except BaseException as error:
            self._stack.close()
            if isinstance(error, OSError):
                raise unwritable(self.folder, error) from error
            raise
        self._stack.callback(self._discard)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.close()

    def write(self, name: str, data: bytes | memoryview | str) -> Path:
        """Add a file, text as UTF-8, and return where it will be; InputError where it cannot be
        written.
        """
        path = self.folder / name
        try:
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            if len(self._unnamed) >= MOST_OPEN:
                self._name()
            written = Written(self.folder, data)
        except OSError as error:
            raise unwritable(path, error) from error
        if before := self._unnamed.pop(name, None):
            before.close()
        self._unnamed[name] = written
        self._names[name] = None
        return path

    def commit(self, instead_of: Iterable[str] = ()) -> None:
        """Put the files in force, and take away others of the folder.

        Args:
            instead_of: patterns of names, such as map_*m.npz, that stay only if they were written.

        Raises:
            InputError: it cannot be; the folder is as it was.
        """
        whole = self.folder / WHOLE
        try:
            removed = {
                path.name
                for pattern in instead_of
                for path in self.folder.glob(pattern)
                if not path.is_dir()
            } - self._names.keys()
            self._name()
            with Written(self.folder, json.dumps(sorted(removed))) as listed:
                listed.name(self.folder / UNFINISHED / REMOVED)
            _sync(self.folder / UNFINISHED)
            (self.folder / UNFINISHED).rename(whole)
            _sync(self.folder)
            _settle(self.folder)
        except OSError as error:
            raise unwritable(self.folder, error) from error
        self._names.clear()

    def _name(self) -> None:
        """Give what is written its names in the hidden folder."""
        (self.folder / UNFINISHED).mkdir(exist_ok=True)
        for name in list(self._unnamed):
            place = self.folder / UNFINISHED / name
            place.unlink(missing_ok=True)
            self._unnamed[name].name(place)
            self._unnamed.pop(name).close()

    def _discard(self) -> None:
        for written in self._unnamed.values():
            written.close()
        shutil.rmtree(self.folder / UNFINISHED, ignore_errors=True)


def in_force(path: Path) -> Path:
    """Where a file of a set is to be read: at its place, or where a set that was put in force was
    not moved from, and cannot be now.
    """
    settle(path.parent)
    whole = path.parent / WHOLE
    return whole / path.name if (whole / path.name).exists() and not whole.is_symlink() else path


def settle(folder: Path) -> None:
    """Go on with a set that was put in force and not moved to its places, and remove what a writer
    left who was killed.

    Nothing is said where this person may not do that.
    """
    end = time.monotonic() + PATIENCE_S
    while os.path.lexists(folder / WHOLE) or os.path.lexists(folder / UNFINISHED):
        with suppress(OSError, InputError):
            handle = _locked(folder)
            try:
                _settle(folder)
            finally:
                if handle is not None:
                    os.close(handle)
            return
        if (
            not (folder / WHOLE).exists()
            or not os.access(folder, os.W_OK)
            or time.monotonic() > end
        ):
            return
        time.sleep(0.01)


def _settle(folder: Path) -> None:
    """By who holds the folder."""
    whole, unfinished = folder / WHOLE, folder / UNFINISHED
    for hidden in (whole, unfinished):
        if (
            hidden.is_symlink()
        ):  # of nobody's making but a stranger's, who would have us move another folder's files
            hidden.unlink()
    if whole.is_dir():
        listed = whole / REMOVED
        for name in _removed(listed):
            (folder / name).unlink(missing_ok=True)
        for path in whole.iterdir():
            if path != listed:
                path.replace(folder / path.name)
        listed.unlink(missing_ok=True)
        whole.rmdir()
        _sync(folder)
    if unfinished.is_dir():
        shutil.rmtree(unfinished)


def _removed(listed: Path) -> list[str]:
    with suppress(OSError, ValueError, RecursionError):
        names = json.loads(listed.read_bytes())
        if isinstance(names, list):
            return [
                name
                for name in names
                if isinstance(name, str)
                and Path(name).name == name
                and not (listed.parent / name).is_dir()
            ]
    return []


def _locked(folder: Path) -> int | None:
    """The handle that holds the folder until it is closed, or this process ends; None where the
    disk knows no locks.
    """
    if fcntl is None:
        return None
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise unwritable(folder, error) from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise BusyError(
            f"Another calib writes to {folder}: wait until it has ended, or choose another folder"
            " with -o."
        ) from None
    except OSError as error:
        os.close(handle)
        if error.errno in NOT_OF_FOLDERS:
            return None
        raise unwritable(folder, error) from error
    return handle


def _sync(folder: Path) -> None:
    """Wait until the disk has the folder's names."""
    if fcntl is None:
        return
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in NOT_OF_FOLDERS:
            raise
    finally:
        os.close(handle)

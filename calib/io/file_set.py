"""Replace the files of a folder that belong together as one set: every reader and every program
finds the old set or the new one, however the writer ended.

The new files have no names until all of them are on the disk. Then they get their names in the
hidden folder HIDDEN, under NEW, and the files that they replace get a second name there, under OLD.
Each name of the set becomes a symbolic link through HIDDEN/CURRENT, which points to OLD: nothing
has changed for a reader. Renaming one link makes CURRENT point to NEW, and so changes every file at
once. In the end, plain files with the same contents replace the links one by one. If a kill
interrupts this, the names still lead to one complete set, and the next process of calib that reads
or writes the folder finishes the change. A folder has one writer at a time.

On a disk without symbolic links, CURRENT is a plain file. It says that the new set is valid, and
then the files are moved one by one. After a kill in between, a reader other than calib sees old
files beside new ones until calib has read or written there.

output_folder defines what may be replaced or removed. docs/decisions/output-folders.md has the
reasons.
"""

import json
import os
import shutil
import time
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from dataclasses import asdict
from enum import Enum
from pathlib import Path
from types import TracebackType
from typing import Self

from calib.errors import InputError
from calib.io.files import UnnamedFile, check_writable, make_folder, read_file, unwritable
from calib.io.folder_lock import UNSUPPORTED_ERRORS, lock_folder
from calib.io.output_folder import ANOTHER_FOLDER, LEDGER, Content, OutputFolder

HIDDEN = ".refracal-set"
OLD = "old"
NEW = "new"
CURRENT = "current"
NEXT = "next"
"""A link or file in HIDDEN that will be renamed to its final name."""
MAX_OPEN_FILES = 100
"""The largest number of files without a name. Each of them is open, and systems allow 256 or more.
"""
PATIENCE_S = 2.0
"""The time in s for which a reader waits for a writer that moves files. Moving takes milliseconds.
"""


class State(Enum):
    """The progress of a change of the folder."""

    NONE = "none"
    """No name of the folder has changed."""
    OLD = "old"
    """Links lead to the old files."""
    NEW = "new"
    """Links lead to the new files."""
    MOVING = "moving"
    """Without links: files are being moved one by one."""


class FileSet:
    """New files for one folder, which is locked inside the `with` block. `commit` makes them the
    current files. Without it, nothing changes, and a folder that was made for them is removed.
    """

    def __init__(
        self,
        folder: Path,
        *,
        overwrite: bool = False,
        inputs: Iterable[Path] = (),
        elsewhere: str = ANOTHER_FOLDER,
        flag: str = "--overwrite",
    ) -> None:
        """The arguments are those of OutputFolder."""
        self.folder = folder
        self._overwrite = overwrite
        self._inputs = tuple(inputs)
        self._elsewhere = elsewhere
        self._flag = flag
        self._unnamed: dict[str, UnnamedFile] = {}
        self._contents: dict[str, Content] = {}
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        """Lock the folder.

        Raises:
            InputError: the folder cannot be made or written.
            BusyError: another process writes to it.
        """
        if not os.path.lexists(self.folder):
            self._stack.callback(_remove_empty, self.folder)
        make_folder(self.folder)
        handle = lock_folder(self.folder)
        if handle is not None:
            self._stack.callback(os.close, handle)
        try:
            check_writable(self.folder)
            _check_hidden(self.folder)
            _finish_change(self.folder)
            self._output()
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

    def reserve(self, names: Iterable[str]) -> None:
        """Check, before the work begins, that the names may be written. InputError names the file
        that prevents it.
        """
        self._output().check(names)

    def write(self, name: str, data: bytes | memoryview | str) -> Path:
        """Add a file, text as UTF-8, and return its future path; InputError if it cannot or may not
        be written.
        """
        path = self.folder / name
        self._output().check([name])
        try:
            if len(self._unnamed) >= MAX_OPEN_FILES:
                self._name_files()
            written = UnnamedFile(self.folder, data)
        except OSError as error:
            raise unwritable(path, error) from error
        if previous := self._unnamed.pop(name, None):
            previous.close()
        self._unnamed[name] = written
        self._contents[name] = Content.of(data)
        return path

    def commit(self, instead_of: Iterable[str] = ()) -> tuple[str, ...]:
        """Make the new files the current ones, and remove older files of ours that they replace.
        Return the names of those that are removed.

        Args:
            instead_of: patterns of names, such as map_*m.npz. A file of ours with such a name is
                removed unless it was written now. A foreign file stays.

        Raises:
            InputError: the files cannot be changed. The folder is unchanged.
        """
        output = self._output()
        output.check(self._contents)  # the work may have taken hours
        try:
            removed = {
                path.name
                for pattern in instead_of
                for path in self.folder.glob(pattern)
                if path.name not in self._contents and output.owns(path.name)
            }
            self._name_files()
            output.add(self._contents)
            _switch(self.folder, {*self._contents, *removed})
            _finish_change(self.folder)
        except OSError as error:
            with suppress(OSError):
                _finish_change(self.folder)
            raise unwritable(self.folder, error) from error
        self._contents.clear()
        return tuple(sorted(removed))

    def _output(self) -> OutputFolder:
        """Return the folder with its list read anew: another command may write there, too."""
        return OutputFolder(
            self.folder,
            overwrite=self._overwrite,
            inputs=self._inputs,
            elsewhere=self._elsewhere,
            flag=self._flag,
        )

    def _name_files(self) -> None:
        """Give the written files their names in the hidden folder."""
        new = self.folder / HIDDEN / NEW
        new.mkdir(parents=True, exist_ok=True)
        for name in list(self._unnamed):
            place = new / name
            place.unlink(missing_ok=True)
            self._unnamed[name].name(place)
            self._unnamed.pop(name).close()

    def _discard(self) -> None:
        for written in self._unnamed.values():
            written.close()
        with suppress(OSError):
            _finish_change(self.folder)


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):  # it has files, or another process works there
        folder.rmdir()


def remove_set(folder: Path) -> None:
    """Remove the files of a folder that are ours, and the folder if nothing else is in it; OSError
    if that fails.
    """
    if folder.is_symlink() or not folder.is_dir():
        return
    finish_change(folder)
    output = OutputFolder(folder)
    for name in output.owned():
        (folder / name).unlink()
    if [path.name for path in folder.iterdir()] == [LEDGER]:
        (folder / LEDGER).unlink()
        folder.rmdir()


def find_current(path: Path) -> Path:
    """Return the path from which a file of a set can be read: its own path, or its path in the
    hidden folder if a valid set could not be moved from there.
    """
    finish_change(path.parent)
    hidden = path.parent / HIDDEN
    moved = hidden / NEW / path.name
    unmoved = _is_hidden_set(hidden) and _state(hidden) is State.MOVING and moved.is_file()
    return moved if unmoved else path


def finish_change(folder: Path) -> None:
    """Finish the change of a folder whose writer was killed: to the new set if that is valid, else
    back to the old one. Do nothing if this person has no permission for it.
    """
    end = time.monotonic() + PATIENCE_S
    while _is_hidden_set(folder / HIDDEN):
        with suppress(OSError, InputError):
            handle = lock_folder(folder)
            try:
                if handle is not None or _state(folder / HIDDEN) is State.MOVING:
                    _finish_change(folder)  # else a writer may be at work, unnoticed
            finally:
                if handle is not None:
                    os.close(handle)
            return
        if (
            _state(folder / HIDDEN) is not State.MOVING
            or not os.access(folder, os.W_OK)
            or time.monotonic() > end
        ):
            return
        time.sleep(0.01)


def _switch(folder: Path, names: Iterable[str]) -> None:
    """Make the new set the current one by a single renaming; OSError if that fails. `names` are the
    names of the files that change.
    """
    hidden = folder / HIDDEN
    changed = sorted(names)
    existing = [name for name in changed if os.path.lexists(folder / name)]
    _sync(hidden / NEW)
    try:
        _point_current(hidden, OLD)
    except (OSError, NotImplementedError):  # FAT, some network disks, Windows
        _decide_to_move(folder, existing)
        return
    (hidden / OLD).mkdir()
    for name in existing:
        _link_or_copy(folder / name, hidden / OLD / name)
    _sync(hidden / OLD)
    for name in changed:
        (hidden / NEXT).symlink_to(_target(name))
        (hidden / NEXT).replace(folder / name)
    _sync(folder)
    _point_current(hidden, NEW)
    _sync(hidden)


def _decide_to_move(folder: Path, existing: Iterable[str]) -> None:
    """Record that the new set is valid, and the old contents that it replaces or removes."""
    hidden = folder / HIDDEN
    contents = {
        name: {
            **asdict(Content.of_file(folder / name)),
            "removed": not (hidden / NEW / name).exists(),
        }
        for name in existing
    }
    with UnnamedFile(hidden, json.dumps(contents)) as decision:
        decision.name(hidden / NEXT)
    (hidden / NEXT).replace(hidden / CURRENT)
    _sync(hidden)


def _point_current(hidden: Path, side: str) -> None:
    """Make CURRENT point to OLD or to NEW."""
    (hidden / NEXT).symlink_to(side)
    (hidden / NEXT).replace(hidden / CURRENT)


def _target(name: str) -> str:
    return f"{HIDDEN}/{CURRENT}/{name}"


def _link_or_copy(path: Path, place: Path) -> None:
    try:
        os.link(path, place)
    except OSError:  # the disk has no hard links, or the file is another person's
        with UnnamedFile(place.parent, path.read_bytes()) as copy:
            copy.name(place)


def _finish_change(folder: Path) -> None:
    """Finish or undo a change; OSError if that fails. The caller has locked the folder."""
    hidden = folder / HIDDEN
    if not _is_hidden_set(hidden):
        return
    state = _state(hidden)
    if state is State.MOVING:
        _move(folder)
    elif state is not State.NONE:
        side = hidden / state.value
        sides = [hidden / name for name in (OLD, NEW) if (hidden / name).is_dir()]
        for name in sorted({path.name for place in sides for path in place.iterdir()}):
            path = folder / name
            if not path.is_symlink() or str(path.readlink()) != _target(name):
                continue
            if os.path.lexists(side / name):
                (side / name).replace(path)
            else:
                path.unlink()
    _sync(folder)
    shutil.rmtree(hidden)


def _move(folder: Path) -> None:
    """Move the files of a set one by one. A file that somebody changed in the meantime stays."""
    hidden = folder / HIDDEN
    replaced, removed = _read_decision(hidden / CURRENT)
    for path in sorted((hidden / NEW).iterdir()):
        place = folder / path.name
        if not os.path.lexists(place) or _has(place, replaced.get(path.name)):
            path.replace(place)
    for name, content in removed.items():
        if _has(folder / name, content):
            (folder / name).unlink()


def _has(path: Path, content: Content | None) -> bool:
    """True if a path is a plain file with this content."""
    return not path.is_symlink() and path.is_file() and Content.of_file(path) == content


def _read_decision(path: Path) -> tuple[dict[str, Content], dict[str, Content]]:
    """Return, by name, the old contents that the new set replaces, and those that it removes; none
    if the file is not as `_decide_to_move` writes it.
    """
    replaced: dict[str, Content] = {}
    removed: dict[str, Content] = {}
    with suppress(InputError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        for name, entry in json.loads(read_file(path)).items():
            if Path(name).name == name:
                content = Content(int(entry["size"]), str(entry["sha256"]))
                (removed if entry["removed"] else replaced)[name] = content
    return replaced, removed


def _state(hidden: Path) -> State:
    current = hidden / CURRENT
    if current.is_symlink():
        target = str(current.readlink())
        return State(target) if target in (OLD, NEW) else State.NONE
    return State.MOVING if current.is_file() else State.NONE


def _is_hidden_set(hidden: Path) -> bool:
    """True if the contents of the folder are as `FileSet` makes them."""
    try:
        return _is_folder(hidden) and all(
            _is_folder(path) and not any(map(_is_folder, path.iterdir()))
            if path.name in (OLD, NEW)
            else (path.name in (CURRENT, NEXT) or path.suffix == ".tmp") and not _is_folder(path)
            for path in hidden.iterdir()
        )
    except OSError:  # it was removed in the meantime, or is not readable
        return False


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _check_hidden(folder: Path) -> None:
    hidden = folder / HIDDEN
    if os.path.lexists(hidden) and not _is_hidden_set(hidden):
        raise InputError(
            f"{hidden} is in the way, and calib did not make it: move it, or {ANOTHER_FOLDER}."
        )


def _sync(folder: Path) -> None:
    """Wait until the folder's names are on the disk."""
    if os.name == "nt":  # Windows opens no folders
        return
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in UNSUPPORTED_ERRORS:
            raise
    finally:
        os.close(handle)

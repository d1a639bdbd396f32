"""The one rule for files that a command writes: it may replace or remove only what Refracal wrote.

Every output folder has a list, LEDGER, with the name, size and SHA-256 of each content that was
written there. A file whose content is on the list is ours. Every other file is foreign: somebody
else made or changed it. A command that would replace it is refused before its work begins, with the
file's name. With `overwrite`, it is replaced. Nothing foreign is ever removed. An input of the same
command, a symbolic link and a folder are always refused.

A content is listed before its file gets its name, so a kill cannot leave a file of ours that is not
listed. Lines are only added: a line records what was written once, so it stays true.
"""

import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from hashlib import file_digest, sha256
from pathlib import Path

from calib.errors import InputError, brief
from calib.io.files import BINARY, read_file, reading, unwritable, write_atomically

LEDGER = ".refracal-files.jsonl"
ANOTHER_FOLDER = "give another folder with -o"
ANOTHER_FILE = "give another file with -o"
BESIDE = "../"
"""The beginning of the name of a file that belongs to the folder but is beside it."""
MAX_NAMES = 4
"""The number of foreign files that one sentence names."""


@dataclass(frozen=True, slots=True)
class Content:
    """The size and digest of a file's content. Different contents have different digests."""

    size: int
    sha256: str

    @staticmethod
    def of(data: bytes | memoryview | str) -> "Content":
        """Return the content of a file with these bytes, or with this text as UTF-8."""
        content = data.encode(errors="backslashreplace") if isinstance(data, str) else data
        view = memoryview(content)
        return Content(view.nbytes, sha256(view).hexdigest())

    @staticmethod
    def of_file(path: Path) -> "Content":
        """Return the content of a file; InputError where it cannot be read."""
        with reading(path), path.open("rb") as file:
            return Content(os.fstat(file.fileno()).st_size, file_digest(file, "sha256").hexdigest())


class OutputFolder:
    """A folder that a command writes to; its files change by the rule of this module."""

    def __init__(
        self,
        path: Path,
        *,
        overwrite: bool = False,
        inputs: Iterable[Path] = (),
        elsewhere: str = ANOTHER_FOLDER,
        flag: str = "--overwrite",
    ) -> None:
        """Read the list of the folder, which need not exist yet.

        Args:
            overwrite: foreign files may be replaced.
            inputs: files that the command reads, which are never replaced.
            elsewhere: the advice for a person who wants to keep a foreign file.
            flag: the option that lets it be replaced; empty if there is none.

        Raises:
            InputError: the list cannot be read, or is another program's file.
        """
        self.path = path
        self._overwrite = overwrite
        self._inputs = tuple(inputs)
        self._elsewhere = elsewhere
        self._flag = flag
        self._listed = _read_ledger(path / LEDGER)

    def place(self, name: str) -> Path:
        """Return the path of a file, which need not exist: a file of the folder, or a file beside
        it if its name begins with BESIDE.
        """
        if name.startswith(BESIDE):
            return self.path.parent / name.removeprefix(BESIDE)
        return self.path / name

    def check(self, names: Iterable[str], *, by_size: bool = False) -> None:
        """Check that the names may be written. InputError names the files that prevent it.

        Args:
            by_size: a file counts as ours if it has the size of a listed content, and is not read.
                This is for very many files, each of which is checked again before it is written.
        """
        foreign = []
        for name in dict.fromkeys(names):
            place = self.place(name)
            if place.is_symlink():
                raise InputError(
                    f"{place} is a symbolic link, and nothing is written through one: remove it, or"
                    f" {self._elsewhere}."
                )
            if not os.path.lexists(place):
                continue
            if place.is_dir():
                raise InputError(
                    f"{place} is a folder, and a file of that name is to be written: rename it, or"
                    f" {self._elsewhere}."
                )
            if any(_is_same(place, source) for source in self._inputs):
                raise InputError(
                    f"{place} would be overwritten, and this command reads it: {self._elsewhere}."
                )
            if not (self._overwrite or self.owns(name, by_size=by_size)):
                foreign.append(name)
        if foreign:
            raise InputError(self._refusal(foreign))

    def owns(self, name: str, *, by_size: bool = False) -> bool:
        """True if the folder has a file of that name, and its content is on the list; `by_size` is
        as in `check`.
        """
        place = self.place(name)
        listed = self._listed.get(name, set())
        if place.is_symlink() or not place.is_file():
            return False
        size = place.stat().st_size
        if not any(content.size == size for content in listed):
            return False
        return by_size or Content.of_file(place) in listed

    def owned(self) -> list[str]:
        """Return the names in the folder whose files are ours."""
        return [name for name in self._listed if Path(name).name == name and self.owns(name)]

    def add(self, contents: Mapping[str, Content]) -> None:
        """Put the contents on the list, before their files get their names; OSError if the list
        cannot be written.
        """
        new = {
            name: content
            for name, content in contents.items()
            if content not in self._listed.get(name, set())
        }
        if new:
            _append(self.path / LEDGER, "".join(_line(*item) for item in new.items()).encode())
        for name, content in new.items():
            self._listed.setdefault(name, set()).add(content)

    def write(self, name: str, data: bytes | memoryview | str) -> Path:
        """Write one file, text as UTF-8, and return its path; InputError if it cannot or may not be
        written.
        """
        place = self.place(name)
        self.check([name])
        try:
            self.add({name: Content.of(data)})
        except OSError as error:
            raise unwritable(place, error) from error
        write_atomically(place, data)
        return place

    def take(self, made: Path, name: str) -> Path:
        """Give a file of the folder its name, and return its path; OSError if that fails,
        InputError if the name may not be written.
        """
        place = self.path / name
        self.check([name])
        self.add({name: Content.of_file(made)})
        return made.replace(place)

    def _refusal(self, foreign: list[str]) -> str:
        is_changed = all(name in self._listed for name in foreign)
        replace = f", or replace what is there with {self._flag}" if self._flag else ""
        advice = f"{self._elsewhere}{replace}"
        listed = _read_ledger(self.path / LEDGER)
        if written := [name for name in foreign if listed.get(name) != self._listed.get(name)]:
            return (
                f"Another calib has written {self.place(written[0])} since this one began:"
                f" {self._elsewhere}, or repeat this command."
            )
        if len(foreign) == 1:
            reason = "has changed since calib wrote it" if is_changed else "is not calib's own"
            return f"{self.place(foreign[0])} {reason}: {advice}."
        names = ", ".join(brief(name) for name in foreign[:MAX_NAMES])
        if len(foreign) > MAX_NAMES:
            names += f" and {len(foreign) - MAX_NAMES} more"
        reason = "have changed since calib wrote them" if is_changed else "are not calib's own"
        return f"{self.path} has {names}, which {reason}: {advice}."


def check_no_link(place: Path) -> Path:
    """Return the place of a folder that a command makes inside another one; InputError if it is a
    symbolic link, which could lead to anybody's files.
    """
    if place.is_symlink():
        raise InputError(
            f"{place} is a symbolic link, and results are not written through one: remove it, or"
            f" {ANOTHER_FOLDER}."
        )
    return place


def _is_same(place: Path, source: Path) -> bool:
    with suppress(OSError):
        return place.samefile(source)
    return False


def _line(name: str, content: Content) -> str:
    listed = {"refracal": 1, "name": name, "size": content.size, "sha256": content.sha256}
    return json.dumps(listed) + "\n"


def _read_ledger(path: Path) -> dict[str, set[Content]]:
    """Return the contents that were written under each name."""
    listed: dict[str, set[Content]] = {}
    if not os.path.lexists(path):
        return listed
    lines = [] if path.is_symlink() else read_file(path).splitlines()
    entries = [_entry(line) for line in lines]
    if path.is_symlink() or (entries and entries[0] is None):
        raise InputError(
            f"{path} is not the list that calib keeps of its files: move it, or {ANOTHER_FOLDER}."
        )
    for entry in entries:
        if entry:  # a kill, or a full disk, may leave a line without its end
            listed.setdefault(entry[0], set()).add(entry[1])
    return listed


def _entry(line: bytes) -> tuple[str, Content] | None:
    with suppress(ValueError, LookupError, TypeError, RecursionError):
        entry = json.loads(line)
        if entry["refracal"] == 1:
            return str(entry["name"]), Content(int(entry["size"]), str(entry["sha256"]))
    return None


def _append(path: Path, data: bytes) -> None:
    """Add lines in one write, so that two processes do not mix theirs."""
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | BINARY | getattr(os, "O_NOFOLLOW", 0)
    handle = os.open(path, flags, 0o666)
    try:
        size = os.fstat(handle).st_size
        if size:
            os.lseek(handle, size - 1, os.SEEK_SET)
            if os.read(handle, 1) != b"\n":
                data = b"\n" + data
        while data:
            data = data[os.write(handle, data) :]
        os.fsync(handle)
    finally:
        os.close(handle)

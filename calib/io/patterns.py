"""Patterns such as 'photos/*.jpg', which the shell leaves as they are if they are quoted."""

import re
from collections.abc import Iterable, Sequence
from glob import has_magic
from pathlib import Path

from calib.errors import InputError, brief
from calib.io.files import reading
from calib.io.images import CONVERTIBLE, OTHER_PICTURES, SUFFIXES, conversion
from calib.io.numerals import counted
from calib.io.shell import shell_path
from calib.io.videos import VIDEOS

ADDRESS = re.compile("(https?|ftp|rtsp):/", re.IGNORECASE)
"""The beginning of the address of a file on another machine."""


def is_pattern(path: Path) -> bool:
    """Return True for a pattern that is not the name of a file."""
    with reading(path):
        return has_magic(str(path)) and not path.exists()


def matches(pattern: Path) -> list[Path]:
    """Return the folders, pictures and videos that match a pattern, sorted by name.

    Raises:
        InputError: nothing matches it.
    """
    paths = _glob(pattern)
    media = [path for path in paths if _is_media(path)]
    if not media:
        raise InputError(f"No picture matches {pattern}{_advice(pattern, paths)}")
    return media


def unread_matches(paths: Iterable[Path]) -> list[Path]:
    """Return the files that match the patterns among the paths, and are not read for their type."""
    return [
        path
        for pattern in paths
        if is_pattern(pattern)
        for path in _glob(pattern)
        if path.suffix.lower() in OTHER_PICTURES and not _is_media(path)
    ]


def _glob(pattern: Path) -> list[Path]:
    """Return what matches a pattern, sorted. As in a shell, hidden names must be typed with their
    dot: macOS leaves a ._DSC1.jpg beside DSC1.jpg.
    """
    path = pattern.expanduser()
    matches = sorted(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
    return [match for match in matches if _hidden(match) <= _hidden(path)]


def _hidden(path: Path) -> set[str]:
    return {name for name in path.parts if name.startswith(".") and name != ".."}


def _is_media(path: Path) -> bool:
    return path.is_dir() or path.suffix.lower() in (*SUFFIXES, *VIDEOS)


def _advice(pattern: Path, paths: Sequence[Path]) -> str:
    """Return what to do about a pattern that matches these paths, which are no pictures."""
    convertible = [path for path in paths if path.suffix.lower() in CONVERTIBLE]
    if convertible:
        return (
            f", only files that are not read as pictures, such as {brief(convertible[0].name)}:"
            f" {conversion(pattern)}."
        )
    for suffix in (pattern.suffix.upper(), pattern.suffix.lower()):
        if media := [path for path in _glob(pattern.with_suffix(suffix)) if _is_media(path)]:
            pattern_word = shell_path(pattern.with_suffix(suffix))
            return f", but {counted(len(media), 'file')} end in {suffix}: give {pattern_word}."
    return ": give a folder, a pattern such as 'photos/*.jpg', or a video."


def expand(paths: Iterable[Path]) -> list[Path]:
    """Return the paths with what matches each pattern in its place.

    Raises:
        InputError: a path is an address, or nothing matches a pattern.
    """
    expanded: list[Path] = []
    for path in paths:
        if ADDRESS.match(str(path)):
            raise InputError(f"{path} is an address: download the file, and give its path.")
        expanded += matches(path) if is_pattern(path) else [path]
    return expanded

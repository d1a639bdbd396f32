"""Patterns such as 'photos/*.jpg', which the shell leaves as they are if they are quoted."""

import re
from collections.abc import Iterable
from glob import has_magic
from pathlib import Path

from calib.errors import InputError
from calib.io.files import reading
from calib.io.images import SUFFIXES
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
    path = pattern.expanduser()
    media = [
        match
        for match in sorted(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
        if match.is_dir() or match.suffix.lower() in (*SUFFIXES, *VIDEOS)
    ]
    if not media:
        raise InputError(
            f"No picture matches {pattern}: give a folder, a pattern such as 'photos/*.jpg', or a"
            " video."
        )
    return media


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

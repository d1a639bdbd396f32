"""Suggestions for the fields that name a path: the rest of the path, as a shell completes it."""

import os
from asyncio import to_thread
from collections.abc import Iterable, Sequence
from pathlib import Path

from textual.suggester import Suggester

from calib.io.images import SUFFIXES
from capture.typed_path import expand_typed_path

FOLDER, VIDEO = "folder:", "video:"


class PathSuggester(Suggester):
    """A suggester for a path that may have `folder:` or `video:` before it, or for a camera."""

    def __init__(self, *, kinds: bool, cameras: Sequence[str] = ()) -> None:
        """`kinds` is True if the field names a source, so that a path has its kind before it."""
        super().__init__(use_cache=False, case_sensitive=True)
        self._kinds = kinds
        self._cameras = cameras

    async def get_suggestion(self, value: str) -> str | None:
        if not self._kinds:
            return await to_thread(complete_path, value, only_folders=True)
        for kind in (FOLDER, VIDEO):
            if value.startswith(kind):
                path = value.removeprefix(kind)
                completed = await to_thread(complete_path, path, only_folders=kind == FOLDER)
                return completed and kind + completed
        kind_or_camera = _first_match(value, (*self._cameras, FOLDER, VIDEO))
        return kind_or_camera or await to_thread(complete_path, value, only_folders=False)


def complete_path(typed: str, *, only_folders: bool) -> str | None:
    """Return the typed path with the rest of the first name that begins like it; None where there
    is none. A folder ends in a slash.
    """
    parent, slash, stem = typed.rpartition("/")
    try:
        with os.scandir(expand_typed_path(parent + slash) if slash else Path()) as entries:
            names = [
                f"{entry.name}/" if entry.is_dir() else entry.name
                for entry in entries
                if entry.name.startswith(stem) and not (entry.name.startswith(".") and not stem)
                if entry.is_dir() or not (only_folders or _is_picture(entry.name))
            ]
    except (OSError, ValueError):  # no such folder, or one that may not be read
        return None
    name = _first_match(stem, names)
    return name and f"{parent}{slash}{name}"


def _is_picture(name: str) -> bool:
    """Return True for a picture: its folder is the source."""
    return Path(name).suffix.lower() in SUFFIXES


def _first_match(beginning: str, texts: Iterable[str]) -> str | None:
    longer = (text for text in texts if text.startswith(beginning) and text != beginning)
    return min(longer, default=None)

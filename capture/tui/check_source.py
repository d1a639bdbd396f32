"""Where the pictures come from that a calibration is to be checked with: a camera, or a folder that
has them already.
"""

from asyncio import to_thread
from pathlib import Path
from typing import ClassVar

from calib.errors import InputError
from capture.sources.registry import open_source
from capture.tui.question import Question, keys
from capture.tui.references import cannot_be_opened, played
from capture.typed_path import expand_typed_path

FOLDER = "folder:"


class CheckSourceScreen(Question[str]):
    """Dismissed with a source that can be opened, or None."""

    ABOUT = (
        "Whether the calibration still holds, three to five pictures of its board tell, tilted,"
        " near and far, and what has changed if it does not. Name a camera to take them with, or a"
        " folder of pictures that were taken later than the calibration, folder:PATH."
    )
    NAME = "source"
    LABEL = "pictures from"
    START = "Start"
    BINDINGS: ClassVar = [*keys(START)]

    async def answer(self, text: str) -> str:
        source = f"{FOLDER}{text}" if expand_typed_path(text).is_dir() else text
        open_source(source, self.LABEL)
        if played(source) and (shut := await to_thread(cannot_be_opened, source)):
            raise InputError(shut)
        return source


def folder_of(source: str) -> Path | None:
    """The folder that a source plays back, whose pictures need not be taken again."""
    return (
        expand_typed_path(source.removeprefix(FOLDER).partition("?")[0])
        if source.startswith(FOLDER)
        else None
    )

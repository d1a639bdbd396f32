"""The question for the source of a check's pictures: a camera, or a folder that has them
already.
"""

from asyncio import to_thread
from pathlib import Path
from typing import ClassVar

from calib.errors import InputError
from capture.sources.registry import is_recorded_source, open_source
from capture.tui.path_suggester import FOLDER, PathSuggester
from capture.tui.question import Question, question_bindings
from capture.tui.references import explain_unreadable
from capture.typed_path import expand_typed_path


class CheckSourceScreen(Question[str]):
    """A question that is dismissed with a source that can be opened, or with None."""

    ABOUT = (
        "Three to five pictures of the board, tilted, near and far, show whether the calibration"
        " still holds, and what has changed if it does not. Name a camera to take them with, or a"
        " folder of pictures that were taken later than the calibration, folder:PATH."
    )
    NAME = "source"
    LABEL = "pictures from"
    START = "Start"
    SUGGESTER: ClassVar = PathSuggester(kinds=True)
    BINDINGS: ClassVar = [*question_bindings(START)]

    async def answer(self, text: str) -> str:
        if text in ("", FOLDER):
            raise InputError("Name a folder of pictures, or a camera such as v4l2:/dev/video0.")
        source = f"{FOLDER}{text}" if expand_typed_path(text).is_dir() else text
        open_source(source, self.LABEL)
        if is_recorded_source(source) and (problem := await to_thread(explain_unreadable, source)):
            raise InputError(problem)
        return source


def playback_folder(source: str) -> Path | None:
    """Return the folder that a source plays back, whose pictures need not be taken again; None for
    a camera.
    """
    return (
        expand_typed_path(source.removeprefix(FOLDER).partition("?")[0])
        if source.startswith(FOLDER)
        else None
    )

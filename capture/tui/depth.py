"""The question for the depth at which the live picture is undistorted."""

import argparse
from typing import ClassVar

from calib.commands.arguments import depth
from calib.errors import InputError
from capture.tui.question import Question, question_bindings


class DepthScreen(Question[float]):
    """A question that is dismissed with a depth in m, or with None."""

    ABOUT = (
        "The live picture is shown as a camera without a cover would take it, with straight lines"
        " over it. Objects at this depth, in metres from the lens along its axis, then appear"
        ' straight and in their place. "As it is" then ends it.'
    )
    NAME = "depth"
    LABEL = "depth in metres"
    START = "Show it straight"
    BINDINGS: ClassVar = [*question_bindings(START)]

    async def answer(self, text: str) -> float:
        try:
            return depth(text)
        except argparse.ArgumentTypeError as error:
            raise InputError(f"{error}.") from error

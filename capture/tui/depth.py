"""At which depth the live picture is straightened."""

import argparse
from typing import ClassVar

from calib.commands.arguments import depth
from calib.errors import InputError
from capture.tui.question import Question, keys


class DepthScreen(Question[float]):
    """Dismissed with a depth in m, or None."""

    ABOUT = (
        "The live picture is shown as a camera without a cover would take it, with straight lines"
        " over it. What is at this depth, in metres from the lens along its axis, is then straight"
        " and in its place; u again shows the picture as it is."
    )
    NAME = "depth"
    LABEL = "depth in metres"
    START = "Show it straight"
    BINDINGS: ClassVar = [*keys(START)]

    async def answer(self, text: str) -> float:
        try:
            return depth(text)
        except argparse.ArgumentTypeError as error:
            raise InputError(f"{error}.") from error

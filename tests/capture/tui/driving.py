"""Driving the app by keys, and reading what stands on its screen."""

import asyncio
import re
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from html import unescape
from pathlib import Path
from typing import Any

from rich.cells import set_cell_size
from textual.events import Key
from textual.pilot import Pilot

from capture.tui.app import CaptureApp

TEXT = re.compile(r'<text [^>]*\bx="([\d.]+)"[^>]*-line-(\d+)\)">([^<]*)</text>')
"""A piece of a line in Textual's drawing of the screen: where it begins, the number of its line, what it says."""
CELL = 12.2  # units of the drawing: letters are 20 high, and 0.61 of that wide
SIZES = ((80, 24), (120, 40))
CONE = ("41.95", "-0.105", "0, -30", "0, 0", "3", "1.5", "1")
"""The fixtures' cover, in the order of the form."""


def drive(story: Coroutine[Any, Any, None]) -> None:
    asyncio.run(story)


@asynccontextmanager
async def running(
    session: Path, source: str = "", size: tuple[int, int] = (80, 24), *, notices: bool = False
) -> AsyncIterator[Pilot[None]]:
    """`notices`: those that come and go over the screen are drawn."""
    app = CaptureApp(session, source)
    app.dots = False  # no terminal tells what it can
    async with app.run_test(size=size, notifications=notices) as pilot:
        await pilot.pause()
        yield pilot


def shown(pilot: Pilot[None]) -> str:
    """The lines of the screen, as a terminal without colours has them."""
    lines = [""] * pilot.app.size.height
    for x, number, text in TEXT.findall(pilot.app.export_screenshot(simplify=True)):
        before = set_cell_size(lines[int(number)], round(float(x) / CELL))  # blanks are not drawn
        lines[int(number)] = before + unescape(text).replace("\N{NO-BREAK SPACE}", " ")
    return "\n".join(line.rstrip() for line in lines)


async def see(pilot: Pilot[None], words: str, within_s: float = 900) -> None:
    """Wait until these words stand on the screen, wherever its lines break."""
    await until(pilot, lambda: words in " ".join(shown(pilot).split()), within_s)


async def until(pilot: Pilot[None], holds: Callable[[], bool], within_s: float = 900) -> None:
    begun = time.monotonic()
    while not holds():
        assert time.monotonic() - begun < within_s, f"it never came:\n{shown(pilot)}"
        await pilot.pause(0.02)
    await pilot.pause()


async def write(pilot: Pilot[None], text: str) -> None:
    """Type over what stands in the field, and go on to the next."""
    await pilot.press("ctrl+u", "ctrl+k", *text, "enter")


async def describe(pilot: Pilot[None], source: str) -> None:
    """Fill the empty form with the fixtures' set-up."""
    await write(pilot, source)
    await write(pilot, "")  # like
    await pilot.press("tab")  # the board is a checkerboard
    for text in ("9", "9", "20"):
        await write(pilot, text)
    await pilot.press("tab")  # the shape is a cone
    for text in CONE:
        await write(pilot, text)


def burst(pilot: Pilot[None], *texts: str) -> None:
    """As over a slow connection: fields and keys arrive at once, before any is looked at. A text of one word in < > is a key."""
    for text in texts:
        if text.startswith("<"):
            pilot.app.post_message(Key(text.strip("<>"), None))
        else:
            for letter in text:
                pilot.app.post_message(Key(letter, letter))

"""Driving the app by keys, and reading its screen."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from textual._context import visible_screen_stack
from textual.events import Key
from textual.pilot import Pilot
from textual.widgets import Select

from capture.tui.app import CaptureApp
from capture.tui.collect import CollectScreen

HANGS_S = 900.0
"""The time in s after which a test gives up on work that goes on, however busy the machine is."""
IDLE_POLLS = 20
"""The looks at an idle app after which a test gives up: nothing can change its screen any more."""
SIZES = ((80, 24), (120, 40))
CONE = ("41.95", "-0.105", "0, -30", "0, 0", "3", "1.5", "1")
"""The fixtures' cover, in the order of the form."""


def drive(story: Coroutine[Any, Any, None]) -> None:
    asyncio.run(story)


@asynccontextmanager
async def running(
    session: Path, source: str = "", size: tuple[int, int] = (80, 24), *, notices: bool = False
) -> AsyncIterator[Pilot[None]]:
    """Run the app. With `notices`, the passing notices over the screen are drawn."""
    app = CaptureApp(session, source)
    app.dots = False  # no terminal tells what it can
    async with app.run_test(size=size, notifications=notices) as pilot:
        await pilot.pause()
        yield pilot


def shown(pilot: Pilot[None]) -> str:
    """Return the lines of the screen, as a terminal without colours has them."""
    visible_screen_stack.set(pilot.app._background_screens)
    return "\n".join(line.text.rstrip() for line in pilot.app.screen._compositor.render_strips())


async def see(pilot: Pilot[None], words: str) -> None:
    """Wait until these words are on the screen, wherever its lines break."""
    await until(pilot, lambda: words in " ".join(shown(pilot).split()))


def sentences_of(pilot: Pilot[None]) -> list[str]:
    """Return a list that collects what the page says from now on: a sentence may be replaced
    before a busy machine looks at the screen.
    """
    page = pilot.app.screen
    assert isinstance(page, CollectScreen)
    sentences: list[str] = []
    say = page.say

    def collecting(sentence: str, for_s: float = 0.0) -> None:
        sentences.append(sentence)
        say(sentence, for_s)

    page.say = collecting  # type: ignore[method-assign]
    return sentences


async def until(pilot: Pilot[None], holds: Callable[[], bool]) -> None:
    """Wait until a condition holds. It is checked again after a twentieth of the time waited so
    far, because a process that fits needs the processor more.

    AssertionError, with the screen: the app is idle, and the condition does not hold.
    """
    start_s = time.monotonic()
    idle_polls = 0
    while not holds():
        waited = time.monotonic() - start_s
        idle_polls = idle_polls + 1 if is_idle(pilot) else 0
        assert idle_polls < IDLE_POLLS, f"nothing goes on, and it never came:\n{shown(pilot)}"
        assert waited < HANGS_S, f"it never came:\n{shown(pilot)}"
        await pilot.pause(min(0.02 + waited / 20, 0.2))
    await pilot.pause()


def is_idle(pilot: Pilot[None]) -> bool:
    """Return True if no worker runs and no timer waits for its only event. Messages on their way
    arrive during the next looks.
    """
    app = pilot.app
    if not all(worker.is_finished for worker in app.workers):
        return False
    nodes = [app, *(node for page in app.screen_stack for node in page.walk_children())]
    nodes += app.screen_stack
    timers = (timer for node in nodes for timer in node._timers if timer._repeat is not None)
    return all(timer._task is None or timer._task.done() for timer in timers)


async def write(pilot: Pilot[None], text: str) -> None:
    """Replace the text of the field, and go on to the next. After every key that it presses, a
    pilot waits for an idle app.
    """
    burst(pilot, "<ctrl+u>", "<ctrl+k>", *text, "<enter>")
    await pilot.pause()


async def describe(pilot: Pilot[None], source: str) -> None:
    """Fill the empty form with the fixtures' set-up."""
    await write(pilot, source)
    await write(pilot, "")  # like
    await pilot.press("tab")  # the board is a checkerboard
    for text in ("9", "9", "20"):
        await write(pilot, text)
    await pilot.press("enter", "c", "enter", "tab")  # the shape is a cone
    for text in CONE:
        await write(pilot, text)


async def start_through_cover(pilot: Pilot[None]) -> None:
    """Choose to record through the cover, and start."""
    pilot.app.screen.query_one("#phase", Select).value = "covered"
    await see(pilot, "record now through the cover")
    await pilot.press("ctrl+s")


async def confirm_cover(pilot: Pilot[None]) -> None:
    """Start, and confirm that the pictures were taken through the cover."""
    await pilot.press("ctrl+s")
    await see(pilot, "Were these pictures taken through the cover? If so, start once more.")
    await pilot.press("ctrl+s")


def burst(pilot: Pilot[None], *texts: str) -> None:
    """Type as over a slow connection: fields and keys arrive at once, before any is handled. A word
    in < > is a key.
    """
    for text in texts:
        if text.startswith("<"):
            pilot.app.post_message(Key(text.strip("<>"), None))
        else:
            for letter in text:
                pilot.app.post_message(Key(letter, letter))

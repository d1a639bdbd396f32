"""Random keys, shapes, types and sources on the set-up screen: python -m tests.fuzz.keys --steps
10000.

The app must live through all of them, and when it ends and is started again, what was typed stands
there.
"""

import argparse
import asyncio
import random
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from textual.widgets import Input, Select

from calib.session.shapes.registry import shape_names
from capture.tui.form import BOARD
from capture.tui.setup import SetupScreen
from tests.capture.tui.driving import running

SAID_EVERY_S = 10.0
SOURCES = (
    "folder:/nowhere",
    "folder:",
    "video:nothing.mp4",
    "v4l2:/dev/null",
    "rpicam:9",
    "x",
    "folder:.?speed=0",
    "libcamera:\x1b",
)
TEXTS = (
    "9",
    "-1",
    "1e300",
    "nan",
    "0, -30",
    "25 ± 10",
    "25 +- 1e300",
    "x" * 300,
    "[/b]",
    "[link=a]b[/link]",
    "\x1b[2J",
    "９",
    "9" * 5000,
    "",
)
KEYS = (
    *(
        "tab",
        "shift+tab",
        "enter",
        "up",
        "down",
        "left",
        "right",
        "home",
        "end",
        "backspace",
        "delete",
        "space",
        "pageup",
        "pagedown",
    ),
    *("ctrl+s", "ctrl+r", "ctrl+u", "ctrl+k", "ctrl+w", "f1", "escape", "question_mark"),
    *"0123456789.,-:/[]xe ",
)
"""Escape leaves a screen, and the set-up for good: it is then started again."""


async def walk(session: Path, steps: int, seed: int) -> int:
    """How many times the app was started; AssertionError where what was typed did not survive.

    What the app raises, it raises here.
    """
    draw = random.Random(seed)
    done = starts = 0
    spoken = time.monotonic()
    previous: dict[str, str] = {}
    while done < steps:
        starts += 1
        async with running(session, size=draw.choice(((80, 24), (120, 40), (20, 5)))) as pilot:
            app = pilot.app
            await pilot.pause()
            assert not previous or texts(app.screen) == previous, (
                f"step {done}: {texts(app.screen)} where {previous} was typed"
            )
            while done < steps and app.is_running:
                done += 1
                if time.monotonic() - spoken > SAID_EVERY_S:
                    spoken = time.monotonic()
                    print(f"{done} of {steps}", file=sys.stderr, flush=True)
                screen = app.screen
                if isinstance(screen, SetupScreen):
                    previous = await step(pilot, screen, draw)
                else:
                    await pilot.press(draw.choice(("escape", "enter", "tab", "escape")))
                    await pilot.pause()
                if app.return_code is not None or app._exit:
                    break
    return starts


async def step(pilot, screen, draw) -> dict[str, str]:  # type: ignore[no-untyped-def]
    """One thing that a person might do; what stands in the form after it."""
    fields, choice = list(screen.query(Input)), draw.random()
    if choice < 0.15 and fields:
        draw.choice(fields).value = draw.choice(TEXTS)
    elif choice < 0.2:
        screen.query_one("#source", Input).value = draw.choice(SOURCES)
    elif choice < 0.3:
        place, values = draw.choice((("#shape", list(shape_names())), ("#kind", list(BOARD))))
        screen.query_one(place, Select).value = draw.choice(values)
    else:
        await pilot.press(draw.choice(KEYS))
    await pilot.pause()
    await pilot.pause()
    return texts(screen)


def texts(screen: object) -> dict[str, str]:
    assert isinstance(screen, SetupScreen)
    return {str(field.id or field.name): field.value for field in screen.query(Input)} | {
        place: str(screen.query_one(place, Select).value) for place in ("#shape", "#kind")
    }


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    with TemporaryDirectory() as folder:
        starts = asyncio.run(walk(Path(folder) / "session", args.steps, args.seed))
    print(
        f"seed {args.seed}, {args.steps} steps, {starts} starts: no exception, and what was typed"
        " survived"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())

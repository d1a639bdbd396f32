"""Chromium as a telephone, driven by nothing but touches and the input of its own keyboard."""

import asyncio
import json
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from tests.capture.tui.browser import Browser, connected
from tests.capture.tui.driving import HANGS_S

SIZE = (390, 844)
"""The size of most telephones in portrait, points."""
DENSE = "--force-device-scale-factor=2"
"""The pixels per point. An emulated density would not do: a canvas is told of the real one."""
LEAST = 44
"""The smallest size that a finger can hit, points."""
AGAIN_S = 10.0
"""The time after which somebody touches again if nothing was hit, s."""
HEAR = """
(() => {
  document.removeEventListener("click", window.hear, true);
  window.touched = window.clicked = false;
  window.hear = (event) => {
    window.clicked = true;
    window.touched ||= Boolean((%s)?.contains(event.target));
  };
  document.addEventListener("click", window.hear, true);
})()
"""
"""A script after which the page says whether an element was touched."""
CLICKED = "window.clicked && !(window.clicked = false)"
PLACE = """
(() => {
  const box = %s;
  if (!box) return null;
  box.scrollIntoView({block: "nearest"});
  const {left, top, width, height} = box.getBoundingClientRect();
  const x = left + width / 2, y = top + height / 2, hit = document.elementFromPoint(x, y);
  return hit && (box === hit || box.contains(hit)) ? {x, y, width, height} : null;
})()
"""
"""A script that gives the place for a finger; null while the element is absent, or something lies
over it.
"""
HIT = """
(() => {
  const {left, top, width, height} = (%s)?.getBoundingClientRect() ?? {};
  const hit = document.elementFromPoint(left + width / 2, top + height / 2);
  const place = [left, top, width, height];
  return [document.body.className, place, hit?.outerHTML, window.clicked].join(" | ");
})()
"""
"""A script that says where an element is, and what lies over it."""
VISIBLE = """
(() => {
  const box = %s;
  if (!box) return false;
  const {left, top, right, bottom} = box.getBoundingClientRect();
  const hits = (x, y) => box.contains(document.elementFromPoint(x, y));
  return top >= 0 && left >= 0 && bottom <= innerHeight && right <= innerWidth && hits(left + 8, top + 4) && hits(right - 8, bottom - 4);
})()
"""  # noqa: E501
"""A script that says whether a person sees the whole of an element, without scrolling."""
ENDED = 'document.body.classList.contains("-closed")'
WORDS = 'document.getElementById("thumb").hidden ? "" : document.getElementById("thumb").innerText'


class Telephone(Browser):
    async def see(self, words: str) -> None:
        """Wait until the page shows these words."""
        start_s = time.monotonic()
        while not await self.shows(words):
            assert time.monotonic() - start_s < HANGS_S, (
                f"{words!r} never came:\n{await self.words()}"
            )
            await asyncio.sleep(0.1)

    async def shows(self, words: str) -> bool:
        return words in " ".join((await self.words()).split())

    async def words(self) -> str:
        return str(await self.evaluate(WORDS))

    async def until(self, holds: str) -> None:
        """Wait until this script returns true."""
        start_s = time.monotonic()
        while not await self.evaluate(holds):
            assert time.monotonic() - start_s < HANGS_S, (
                f"{holds} never came:\n{await self.words()}"
            )
            await asyncio.sleep(0.1)

    async def resize(self, size: tuple[int, int]) -> None:
        """Set the size of the page, points: an open keyboard takes a part of its height."""
        await self.emulate(size)
        await self.until(f"innerWidth === {size[0]} && innerHeight === {size[1]}")

    async def emulate(self, size: tuple[int, int]) -> None:
        """Set the size of the screen, points, which the next page of an address will have."""
        await self.do(
            "Emulation.setDeviceMetricsOverride",
            width=size[0],
            height=size[1],
            deviceScaleFactor=0,
            mobile=True,
        )

    async def let_go(self) -> None:
        """Close the keyboard, as its own key does."""
        await self.evaluate("document.activeElement.blur()")

    async def tap(self, what: str, minimum: float = LEAST, *, unless: str = "false") -> bool:
        """Touch the element that this script finds, once it can be touched; it is at least
        `minimum` points wide and high. What has just opened or closed above it may have moved it
        away from under the finger: a person who sees that touches it again. Return False if the
        script `unless` returned true before the element was touched.
        """
        start_s = time.monotonic()
        await self.evaluate(HEAR % what)
        while not await self.evaluate("window.touched"):
            if await self.evaluate(unless):
                return bool(await self.evaluate("window.touched"))
            assert time.monotonic() - start_s < HANGS_S, (
                f"nothing to touch: {what}\n{await self.evaluate(HIT % what)}\n{await self.words()}"
            )
            assert not await self.evaluate(ENDED), f"the app has ended before {what} was touched"
            place = await self.evaluate_json(PLACE % what)
            await asyncio.sleep(0.1)
            if place is None or place != await self.evaluate_json(PLACE % what):
                continue  # it is hidden, or it moves: the finger might touch its neighbour, Quit
            assert min(place["width"], place["height"]) >= minimum, (
                f"{what} is smaller than a finger: {place}"
            )
            touched = [{"x": place["x"], "y": place["y"]}]
            await self.do("Input.dispatchTouchEvent", type="touchStart", touchPoints=touched)
            await self.do("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
            clicked_s = time.monotonic()
            while time.monotonic() - clicked_s < AGAIN_S and not await self.evaluate(CLICKED):
                await asyncio.sleep(0.05)
        return True

    async def press(self, *keys: str) -> None:
        """Touch the large buttons of these keys of the app."""
        for key in keys:
            await self.tap(f"document.querySelector('nav [data-key={json.dumps(key)}]')")

    async def press_until(self, key: str, words: str) -> None:
        """Touch the large button of a key until the page shows these words: on a busy machine a
        touch may be lost, and a person touches again what is still there.
        """
        start_s = time.monotonic()
        button = f"document.querySelector('nav [data-key={json.dumps(key)}]')"
        while True:
            if await self.evaluate(f"{button} !== null"):
                await self.tap(button)
            for _ in range(300):
                if await self.shows(words):
                    return
                await asyncio.sleep(0.1)
            assert time.monotonic() - start_s < HANGS_S, (
                f"{words!r} never came:\n{await self.words()}"
            )

    async def fill(self, label: str, text: str) -> None:
        """Touch a field and write: the first touch selects its text. A page that is drawn anew
        takes the letters away from it: a person who sees that touches it again.
        """
        field = f"document.getElementById({json.dumps(f'field-{label}')})"
        start_s = time.monotonic()
        while not await self.evaluate(f"document.activeElement === {field}"):
            assert time.monotonic() - start_s < HANGS_S, f"{label} takes no letters"
            await self.tap(field)
            await asyncio.sleep(0.1)
        await self.do("Input.insertText", text=text)

    async def choose(self, label: str, option: str) -> None:
        """Open a choice, and take the option that begins with this text. On a busy machine a late
        touch may close the list again: a person who sees that opens it once more.
        """
        choice = f"document.getElementById({json.dumps(f'choice-{label}')})"
        is_open = f"!{choice}.parentElement.querySelector('ul').hidden"
        options = f"[...{choice}.parentElement.querySelectorAll('li button')]"
        option = f"{options}.find((each) => each.textContent.startsWith({json.dumps(option)}))"
        start_s = time.monotonic()
        while True:
            assert time.monotonic() - start_s < HANGS_S, f"{label} does not open"
            await self.tap(choice)
            for _ in range(100):
                if await self.evaluate(is_open):
                    break
                await asyncio.sleep(0.1)
            if await self.tap(option, unless=f"!({is_open})"):
                return

    async def evaluate_json(self, script: str) -> dict[str, float] | None:
        text = await self.evaluate(f"JSON.stringify({script.strip()})")
        result: dict[str, float] | None = json.loads(text)
        return result


@asynccontextmanager
async def telephone(
    address: str, profile: Path, size: tuple[int, int] = SIZE
) -> AsyncIterator[Telephone]:
    """Open a page that shows this address."""
    async with connected(profile, DENSE) as socket:
        phone = Telephone(socket)
        await phone.emulate(size)
        await phone.do("Emulation.setTouchEmulationEnabled", enabled=True)
        await phone.arrive(address, f'document.body.classList.contains("-shown") && {WORDS} !== ""')
        yield phone

"""A page in Chromium whose console and network are watched, with a mouse."""

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from tests.capture.tui.browser import Browser, connected

DESK, PHONE = (1280, 900), (390, 844)
"""px: of a window, and of most telephones."""
DRAWN = 'document.documentElement?.dataset.drawn === ""'
LOADED = 'document.readyState === "complete"'
WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Chromium draws 3D without a graphics card."""
PLACE = """(() => {{ const e = document.querySelector({what!r});
e.scrollIntoView({{block: "center"}});
const r = e.getBoundingClientRect(); return [r.left, r.top, r.width, r.height]; }})()"""
DOT = """(() => {{ const path = document.querySelector({what!r} + " .dots path");
if (!path) return null;
path.scrollIntoView({{block: "center"}});
const [, x, y] = path.getAttribute("d").match(/M([-.0-9]+) ([-.0-9]+)/);
const at = new DOMPoint(x, y).matrixTransform(path.getScreenCTM()); return [at.x, at.y]; }})()"""
RAYS = "Number(document.querySelector('.scene').dataset.rays)"
"""The number of rays that the scene shows."""
TIP = "document.querySelector({what!r} + ' [aria-label=tip] text')?.textContent"

Result = TypeVar("Result")
Story = Callable[["Page"], Coroutine[Any, Any, Result]]


class Page(Browser):
    """A report in a browser whose network and console are watched."""

    async def call(self, script: str) -> Any:
        result = await self.do("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    async def until(self, condition: str) -> bool:
        """Return true as soon as a condition holds, and false after eight seconds without it."""
        for _ in range(400):
            if await self.holds(condition):
                return True
            await asyncio.sleep(0.02)
        return False

    async def mouse(self, kind: str, x: float, y: float, buttons: int = 0) -> None:
        button = "left" if buttons or kind == "mouseReleased" else "none"
        await self.do(
            "Input.dispatchMouseEvent",
            type=kind,
            x=x,
            y=y,
            button=button,
            buttons=buttons,
            clickCount=int(kind != "mouseMoved"),
        )

    async def click(self, x: float, y: float) -> None:
        await self.mouse("mousePressed", x, y, 1)
        await self.mouse("mouseReleased", x, y)

    async def drag(self, x: float, y: float, dx: float, dy: float) -> None:
        await self.mouse("mousePressed", x, y, 1)
        for fraction in (0.3, 0.7, 1.0):
            await self.mouse("mouseMoved", x + fraction * dx, y + fraction * dy, 1)
        await self.mouse("mouseReleased", x + dx, y + dy)

    async def hover(self, what: str) -> str:
        """Point at a dot of a chart, and return what the chart says of it."""
        text = None
        for _ in range(400):  # the chart is drawn in the browser's next frame
            if place := await self.call(DOT.format(what=what)):
                await self.mouse("mouseMoved", *place)
                if text := await self.call(TIP.format(what=what)):
                    break
            await asyncio.sleep(0.02)
        return text or ""

    async def middle(self, what: str) -> tuple[float, float]:
        """Scroll to an element, and return its middle in px of the window."""
        x, y, width, height = await self.call(PLACE.format(what=what))
        return x + width / 2, y + height / 2


class Chrome:
    """One browser for all tests of a file."""

    def __init__(self, loop: asyncio.AbstractEventLoop, page: Page) -> None:
        self._loop = loop
        self._page = page

    def read(
        self,
        html: str,
        folder: Path,
        story: Story[Result],
        size: tuple[int, int] = DESK,
        scheme: str = "light",
        ready: str = DRAWN,
    ) -> tuple[Result, list[str], list[str]]:
        """Return what a story finds on a page, what its console text, and what it requests for."""
        file = folder / "page.html"
        file.write_text(html)
        return self.visit(file.as_uri(), story, size, scheme, ready)

    def visit(
        self,
        address: str,
        story: Story[Result],
        size: tuple[int, int] = DESK,
        scheme: str = "light",
        ready: str = DRAWN,
    ) -> tuple[Result, list[str], list[str]]:
        """Return the same of a page at an address."""
        return self._loop.run_until_complete(self._visit(address, story, size, scheme, ready))

    async def _visit(
        self, address: str, story: Story[Result], size: tuple[int, int], scheme: str, ready: str
    ) -> tuple[Result, list[str], list[str]]:
        page = self._page
        await page.do("Page.navigate", url="about:blank")
        width, height = size
        await page.do(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        await page.do(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-color-scheme", "value": scheme}],
        )
        await page.do("Log.enable")
        await page.do("Network.enable")
        page.complaints.clear()
        page.requests.clear()
        await page.arrive(address, f'location.href !== "about:blank" && {ready}')
        result = await story(page)
        requests = [url for url in page.requests if not url.startswith(("data:", "file:", "blob:"))]
        complaints = [line for line in page.complaints if "GL Driver Message" not in line]
        return result, complaints, requests  # without what the software renderer says of its speed


@contextmanager
def open_chrome(profile: Path) -> Iterator[Chrome]:
    loop = asyncio.new_event_loop()
    opened = connected(profile, *WEBGL)
    socket = loop.run_until_complete(opened.__aenter__())
    try:
        yield Chrome(loop, Page(socket))
    finally:
        loop.run_until_complete(opened.__aexit__(None, None, None))
        loop.close()

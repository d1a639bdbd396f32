"""Chromium without a window, driven over its DevTools protocol: keys go in, the terminal's text and
pictures come out.
"""

import asyncio
import base64
import shutil
import subprocess
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from aiohttp import ClientSession, ClientWebSocketResponse

from tests.capture.tui.driving import HANGS_S

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
)
HOOK = """
Object.defineProperty(Object.prototype, "fitAddon", {configurable: true, set(addon) {
  window.served = this;
  Object.defineProperty(this, "fitAddon", {value: addon, writable: true});
}});
"""
"""A script that keeps a reference to the page's terminal, which is drawn and has no text in the
document.
"""
TEXT = """
(() => {
  const buffer = window.served?.terminal.buffer.active;
  return buffer ? Array.from({length: buffer.length}, (_, row) => buffer.getLine(row).translateToString(true)).join("\\n") : "";
})()
"""  # noqa: E501
READY = 'document.activeElement.className === "xterm-helper-textarea"'
CONTROL = 2
CODES = {"Enter": 13, "Escape": 27, "Tab": 9, "ArrowDown": 40}


class NavigatedError(Exception):
    """The page went to another address while it was asked."""


class Browser:
    """One page."""

    def __init__(self, socket: ClientWebSocketResponse) -> None:
        self.complaints: list[str] = []
        """The warnings and errors of the page's console."""
        self.requests: list[str] = []
        """The addresses that the page asked for, after `Network.enable`."""
        self._socket = socket
        self._asked = 0

    async def do(self, method: str, **parameters: object) -> dict[str, Any]:
        self._asked += 1
        await self._socket.send_json({"id": self._asked, "method": method, "params": parameters})
        while True:
            message = await self._socket.receive_json(timeout=600)
            self._note(message.get("method", ""), message.get("params", {}))
            if message.get("id") == self._asked:
                if "navigated" in message.get("error", {}).get("message", ""):
                    raise NavigatedError(message)
                assert "error" not in message, message
                result: dict[str, Any] = message["result"]
                return result

    def _note(self, event: str, parameters: dict[str, Any]) -> None:
        kinds = {parameters.get("type"), parameters.get("entry", {}).get("level")}
        if event == "Runtime.exceptionThrown" or kinds & {"error", "warning"}:
            self.complaints.append(str(parameters))
        if event == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])

    async def open(self, address: str) -> None:
        await self.arrive(address, READY)  # the page itself lets keys in, without a click

    async def evaluate(self, script: str) -> Any:
        return (await self.do("Runtime.evaluate", expression=script))["result"].get("value")

    async def holds(self, condition: str) -> bool:
        """Return whether a condition holds, and false while the page goes to another address."""
        try:
            return bool(await self.evaluate(condition))
        except NavigatedError:
            return False

    async def arrive(self, address: str, ready: str) -> None:
        """Open a page, and wait until this condition holds on it."""
        await self.do("Runtime.enable")
        await self.do("Page.enable")
        await self.do("Page.addScriptToEvaluateOnNewDocument", source=HOOK)
        await self.do("Page.navigate", url=address)
        start_s = time.monotonic()
        while not await self.holds(ready):
            assert time.monotonic() - start_s < 240, f"{address} never got so far: {ready}"
            await asyncio.sleep(0.1)

    async def shown(self) -> str:
        return str(await self.evaluate(TEXT))

    async def see(self, words: str) -> None:
        start_s = time.monotonic()
        while words not in " ".join((await self.shown()).split()):
            assert time.monotonic() - start_s < HANGS_S, (
                f"{words!r} never came:\n{await self.shown()}"
            )
            await asyncio.sleep(0.2)

    async def press(self, *keys: str) -> None:
        """Press a key: a letter, a name of CODES, or ^ and a letter."""
        for key in keys:
            if key in CODES:
                fields = {"key": key, "code": key, "windowsVirtualKeyCode": CODES[key]}
            elif len(key) == 2 and key[0] == "^":
                fields = {
                    "key": key[1],
                    "code": f"Key{key[1].upper()}",
                    "windowsVirtualKeyCode": ord(key[1].upper()),
                    "modifiers": CONTROL,
                }
            else:
                fields = {"key": key, "text": key}
            await self.do("Input.dispatchKeyEvent", type="keyDown", **fields)
            await self.do("Input.dispatchKeyEvent", type="keyUp", **fields)

    async def write(self, text: str) -> None:
        """Replace the text of the field, and go on to the next."""
        await self.press("^u", "^k", *text, "Enter")

    async def picture(self, file: Path) -> None:
        message = await self.do("Page.captureScreenshot", format="png")
        file.write_bytes(base64.b64decode(message["data"]))


@asynccontextmanager
async def browsing(address: str, profile: Path, size: tuple[int, int]) -> AsyncIterator[Browser]:
    """Open a page with this address in a window of this size, px."""
    async with connected(profile) as socket:
        browser = Browser(socket)
        await browser.do(
            "Emulation.setDeviceMetricsOverride",
            width=size[0],
            height=size[1],
            deviceScaleFactor=1,
            mobile=False,
        )
        await browser.open(address)
        yield browser


@asynccontextmanager
async def connected(profile: Path, *flags: str) -> AsyncIterator[ClientWebSocketResponse]:
    """Return the DevTools of an empty page."""
    assert CHROMIUM
    command = [
        *(CHROMIUM, *FLAGS, *flags),
        *("--remote-debugging-port=0", f"--user-data-dir={profile}", "about:blank"),
    ]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        port = profile / "DevToolsActivePort"
        for _ in range(300):
            if port.exists() and port.read_text().count("\n"):
                break
            await asyncio.sleep(0.1)
        host = f"http://127.0.0.1:{port.read_text().split()[0]}"
        async with ClientSession() as session:
            async with session.get(f"{host}/json") as answer:
                page = next(item for item in await answer.json() if item["type"] == "page")
            async with session.ws_connect(page["webSocketDebuggerUrl"], max_msg_size=0) as socket:
                yield socket
    finally:
        process.terminate()
        process.wait(30)

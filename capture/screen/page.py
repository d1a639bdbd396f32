"""The page that shows patterns in a browser beside the camera.

It holds one websocket. The program sends what to show and sentences for the person; the page
answers when a pattern has been on the screen for two of its frames, and sends what the person
enters. The newest page counts: one that is opened later ends the one before.
"""

import asyncio
import base64
import json
import logging
import queue
import secrets
import socket
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from calib.errors import InputError
from calib.extras import how_to_install
from calib.fringes.pattern import ScreenPattern
from calib.io.json_text import json_text
from capture.listening import is_loopback, open_sockets, reachable_address

try:
    from aiohttp import WSMsgType, web

    from capture.guard import Guard
    from capture.guarded_server import CLOSING_S, guarded_server
except ImportError as error:
    raise InputError(f"--serve needs one more package: {how_to_install('serve')}") from error

WEB = Path(__file__).parents[1] / "web"
COOKIE = "refracal-screen"
HEARTBEAT_S = 20.0
"""The time in s between questions whether the page is there. It has half of that to answer."""
MAX_MESSAGE_BYTES = 1 << 12
"""bytes of a message from the page; a longer one ends the connection."""
MAX_WAITING = 1000
"""Messages that wait to be read; a page that sends more is not ours."""
REPLACED = 4000
"""The code of the websocket's end by which a page knows that another one took over."""


@dataclass(frozen=True, slots=True)
class Event:
    """A message of a page."""

    page: int
    """The number of the page, which counts those that were opened."""
    time_s: float
    """Monotonic clock, when it came."""
    message: Mapping[str, object]
    """Empty when the page has gone."""


class PatternPage:
    """The server of the page, in a thread of its own, between entering and leaving the `with`."""

    def __init__(self, host: str, port: int) -> None:
        """`port` 0 is one that is free. A loopback address is served without a token."""
        self._host = host
        self._port = port
        self._guard = Guard(None if is_loopback(host) else secrets.token_urlsafe(24), COOKIE)
        self._events: queue.Queue[Event] = queue.Queue(MAX_WAITING)
        self._socket: web.WebSocketResponse | None = None
        self._pages = 0
        self._ready = threading.Event()

    @property
    def address(self) -> str:
        """The address of the page, with its token; known once entered."""
        reached = reachable_address(self._host)
        shown = f"[{reached}]" if ":" in reached else reached
        token = f"?token={self._guard.token}" if self._guard.token else ""
        return f"http://{shown}:{self._port}/{token}"

    @property
    def has_token(self) -> bool:
        """True if other machines can open the page."""
        return self._guard.token is not None

    def __enter__(self) -> Self:
        sockets = open_sockets(self._host, self._port)
        self._port = sockets[0].getsockname()[1]
        for noisy in ("aiohttp", "asyncio"):  # requests of strangers are no news
            logging.getLogger(noisy).setLevel(logging.CRITICAL)
        self._thread = threading.Thread(target=self._run, args=(sockets,), name="page", daemon=True)
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._loop.call_soon_threadsafe(self._serving.cancel)
        self._thread.join(3 * CLOSING_S)

    def next_event(self, timeout_s: float) -> Event | None:
        """Return the oldest message that was not read yet; None if none comes in time."""
        try:
            return self._events.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def send(self, message: Mapping[str, object]) -> None:
        """Send a message to the page, if there is one."""
        self._send(json_text(message))

    def show(self, number: int, pattern: ScreenPattern) -> None:
        """Have the page show a pattern, and answer with its number."""
        lines = {"columns": pattern.columns, "rows": pattern.rows}
        encoded = {name: base64.b64encode(line.tobytes()).decode() for name, line in lines.items()}
        self.send({"show": number, **encoded})

    def send_picture(self, jpeg: bytes) -> None:
        """Send the camera's picture, for the person."""
        self._send(jpeg)

    def _send(self, data: str | bytes) -> None:
        with suppress(RuntimeError):  # the loop has ended
            asyncio.run_coroutine_threadsafe(self._deliver(data), self._loop)

    async def _deliver(self, data: str | bytes) -> None:
        page = self._socket
        if page is None:
            return
        with suppress(ConnectionError, RuntimeError):  # the page has gone
            await (page.send_str(data) if isinstance(data, str) else page.send_bytes(data))

    def _run(self, sockets: list[socket.socket]) -> None:
        try:
            asyncio.run(self._serve(sockets))
        finally:
            self._ready.set()

    async def _serve(self, sockets: list[socket.socket]) -> None:
        self._loop = asyncio.get_running_loop()
        app = web.Application(client_max_size=MAX_MESSAGE_BYTES)
        app.router.add_get("/", self._send_page)
        app.router.add_get("/screen", self._follow)
        app.router.add_static("/page", WEB)
        hosts = {f"{name}:{self._port}" for name in ("127.0.0.1", "localhost", "[::1]", self._host)}
        async with guarded_server(app, sockets, self._guard, hosts) as self._serving:
            self._ready.set()
            with suppress(asyncio.CancelledError):
                await self._serving
            if self._socket is not None:
                with suppress(Exception):
                    await asyncio.wait_for(self._socket.close(), CLOSING_S)

    async def _send_page(self, _: web.Request) -> web.StreamResponse:
        return web.FileResponse(WEB / "screen.html")

    async def _follow(self, request: web.Request) -> web.StreamResponse:
        """Serve one page until it goes or another one is opened."""
        page = web.WebSocketResponse(heartbeat=HEARTBEAT_S, max_msg_size=MAX_MESSAGE_BYTES)
        await page.prepare(request)
        previous, self._socket = self._socket, page
        self._pages += 1
        number = self._pages
        if previous is not None:
            with suppress(Exception):
                await asyncio.wait_for(previous.close(code=REPLACED), CLOSING_S)
        async for message in page:
            read = _parse(message.data) if message.type == WSMsgType.TEXT else None
            if read and not self._put(Event(number, time.monotonic(), read)):
                break
        if self._socket is page:
            self._socket = None
        self._put(Event(number, time.monotonic(), {}))
        return page

    def _put(self, event: Event) -> bool:
        try:
            self._events.put_nowait(event)
        except queue.Full:
            return False
        return True


def _parse(text: str) -> Mapping[str, object] | None:
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) else None

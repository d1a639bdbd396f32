"""The terminal UI in a browser, for a phone or a laptop beside the camera.

Only the person at this machine may drive a camera through it. On a loopback address the request
must name that address, so that no page of the web can reach it under another name. On any other
address every request, including the websocket's, must bring the token that is printed once, in its
address or in the cookie that the first page leaves. Only our own page, which no other page can
frame, may open a websocket. Of the files of this machine, those alone are served that an app has
offered to its page. The number of apps is limited, to one by default: the next window ends
the oldest. A connection without an admitted request is closed after some seconds
(`doorkeeper.py`). An app ends with its window, with this server however that ends, and when nobody
has touched it for hours.
"""

import asyncio
import json
import logging
import os
import secrets
import shlex
import signal
import socket
import sys
import time
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from calib.errors import InputError
from calib.extras import how_to_install
from capture.listening import is_loopback, open_sockets, reachable_address
from capture.orphan import SERVER

try:
    from aiohttp import WSMsgType, web
    from textual_serve.server import Server

    from capture.doorkeeper import Doorkeeper
    from capture.guard import HEADERS, Guard
    from capture.offered_files import send_files
    from capture.qr_code import qr_code
    from capture.served_app import ServedApp
except ImportError as error:
    raise InputError(f"--serve needs one more package: {how_to_install('serve')}") from error

COOKIE = "refracal"
WEB = Path(__file__).parent / "web"
"""The folder of our pages: the one around Textual's terminal, and the one that draws the same app
for a thumb.
"""
MAX_IDLE_S = 4 * 3600.0
"""The time in s after which an untouched app ends: moving a board takes an hour at most."""
GRACE_S = 5.0
"""The time in s that an app gets to end, or to take a key, before it is killed."""
HEARTBEAT_S = 60.0
"""The time in s between questions whether the window is there. It has half of that to answer: a
busy machine may stand still for ten seconds, and an app that ends then loses what was typed.
"""
MAX_MESSAGE_BYTES = 1 << 16
"""The maximum size of a message from the browser, bytes; a longer one ends the connection."""
MAX_PASTE_LENGTH = 4096
"""The maximum number of characters of one input; typed texts are much shorter."""
TERMINAL_SIZES = {"width": (20, 500), "height": (5, 200)}
"""The limits of the terminal's size that the app may get."""
ENDING = (signal.SIGINT, signal.SIGTERM)
"""Signals that end the server."""
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class GuardedServer(Server):
    """The server of textual-serve, behind the guard."""

    def __init__(
        self, command: str, host: str, port: int, token: str | None, apps: int = 1
    ) -> None:
        """`token` None serves a loopback address without one. `apps` is the maximum number of apps
        at a time.
        """
        super().__init__(command, host, port, title="Refracal", templates_path=WEB)
        self.guard = Guard(token, COOKIE)
        self._max_apps = apps
        self._running: dict[ServedApp, web.WebSocketResponse] = {}
        """The running apps, the oldest first."""
        self._offers: dict[str, Sequence[Path]] = {}
        """The files that apps have offered to their pages, by the keys of their addresses."""
        self._opening = asyncio.Lock()
        self._door: Doorkeeper | None = None

    async def _make_app(self) -> web.Application:
        app = await super()._make_app()
        app.router.add_static("/page", WEB)
        app.router.add_get("/files/{key}/{name}", self.handle_offer)

        @web.middleware
        async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
            return await self._guard(request, handler)

        app.middlewares.append(guard)
        app.on_startup.clear()  # it would print a banner whose address lacks the token
        app.on_shutdown.clear()
        app.on_shutdown.append(self.end_all)
        return app

    async def run(self, listening: list[socket.socket]) -> None:
        """Serve until a signal ends it; a second one does not wait for the apps."""
        runner = web.AppRunner(
            await self._make_app(), access_log=None
        )  # a log would repeat the token
        await runner.setup()
        assert runner.server
        self._door = Doorkeeper(runner.server)
        loop = asyncio.get_running_loop()
        servers = [await loop.create_server(self._door, sock=one) for one in listening]
        watching = loop.create_task(self._door.watch())
        with suppress(NotImplementedError):  # Windows: Ctrl-C cancels this task
            for number in ENDING:
                loop.add_signal_handler(number, watching.cancel)
        try:
            await watching
        finally:
            for number in ENDING:
                with suppress(NotImplementedError):
                    loop.remove_signal_handler(number)
            for server in servers:
                server.close()
            await runner.cleanup()

    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        hosts = {f"{name}:{self.port}" for name in ("127.0.0.1", "localhost", "[::1]", self.host)}
        if not self.guard.admits(request, hosts):
            return web.Response(status=403, headers=HEADERS)
        if self._door:
            self._door.admit(request.protocol)
        # the address as the browser knows it
        self.public_url = f"{request.scheme}://{request.host}"
        response = await handler(request)
        self.guard.seal(request, response)
        return response

    async def handle_offer(self, request: web.Request) -> web.StreamResponse:
        """Serve files that an app has offered, and no others; also after its window was closed."""
        return await send_files(request, self._offers.get(request.match_info["key"], ()))

    async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
        """Serve one window and its app, until either has ended."""
        websocket = web.WebSocketResponse(heartbeat=HEARTBEAT_S, max_msg_size=MAX_MESSAGE_BYTES)
        await websocket.prepare(request)
        service = ServedApp(
            self.command,
            websocket,
            partial(_close, websocket),
            self.download_manager,
            self._offers.__setitem__,
        )
        async with self._opening:  # the session is free once the app before has ended
            while len(self._running) >= self._max_apps:
                oldest = next(iter(self._running))
                await _close(self._running[oldest])
                await self._end(oldest)
            self._running[service] = websocket
            size = _size({key: request.query.get(key, "") for key in TERMINAL_SIZES})
            await service.start(size["width"], size["height"])
        try:
            await self._follow(websocket, service)
        except (
            TimeoutError,
            ConnectionError,
        ):  # the app takes no input any more, or the window has gone
            pass
        finally:
            await self._end(service)
            await _close(websocket)
        return websocket

    async def _follow(self, websocket: web.WebSocketResponse, app_service: ServedApp) -> None:
        """Forward the window's messages, until it is closed or nobody has touched it for long."""
        touched_s = time.monotonic()
        while (remaining_s := touched_s + MAX_IDLE_S - time.monotonic()) > 0:
            message = await websocket.receive(timeout=remaining_s)
            if message.type in (
                WSMsgType.CLOSE,
                WSMsgType.CLOSING,
                WSMsgType.CLOSED,
                WSMsgType.ERROR,
            ):
                return
            match _parse_message(message.data if message.type == WSMsgType.TEXT else ""):
                case ["stdin", str() as keys]:
                    touched_s = time.monotonic()
                    typed = keys[:MAX_PASTE_LENGTH].encode(errors="replace")
                    if not await asyncio.wait_for(app_service.send_bytes(typed), GRACE_S):
                        return
                case ["resize", {"width": width, "height": height}]:
                    size = _size({"width": width, "height": height})
                    await asyncio.wait_for(
                        app_service.set_terminal_size(size["width"], size["height"]), GRACE_S
                    )
                case ["phone", dict() as request]:
                    touched_s = (
                        touched_s if "drawn" in request else time.monotonic()
                    )  # a drawn picture is not a touch of a person
                    await asyncio.wait_for(app_service.forward_request(request), GRACE_S)
                case ["ping", str() | int() | float() | None as payload]:
                    await websocket.send_json(["pong", payload])
                case ["blur"]:
                    await asyncio.wait_for(app_service.blur(), GRACE_S)
                case ["focus"]:
                    await asyncio.wait_for(app_service.focus(), GRACE_S)

    async def _end(self, service: ServedApp) -> None:
        """Ask the app to end, and kill it if it does not; a second call does no harm."""
        if self._running.pop(service, None) is None:
            return
        with suppress(Exception):
            await asyncio.wait_for(service.stop(), GRACE_S)
        process = service._process
        if process and process.returncode is None:
            with suppress(ProcessLookupError):
                process.kill()
            await process.wait()

    async def end_all(self, _: web.Application) -> None:
        await asyncio.gather(*(self._end(service) for service in list(self._running)))


async def _close(websocket: web.WebSocketResponse) -> None:
    """Close the websocket, whatever the window answers."""
    with suppress(Exception):
        await asyncio.wait_for(websocket.close(), GRACE_S)


def _parse_message(text: str) -> object:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _size(requested: dict[str, object]) -> dict[str, int]:
    """Return the terminal's size in cells, within TERMINAL_SIZES."""
    size = {}
    for key, (minimum, maximum) in TERMINAL_SIZES.items():
        with suppress(TypeError, ValueError, OverflowError):
            size[key] = max(minimum, min(maximum, int(str(requested[key])[:9])))
    return {"width": 80, "height": 24} | size


def serve(arguments: Sequence[str], host: str, port: int, apps: int = 1) -> None:
    """Serve the screen that `capture` shows for these arguments until Ctrl-C; InputError if the
    address cannot be used.
    """
    listening = open_sockets(host, port)
    os.environ[SERVER] = str(os.getpid())
    command = ["exec", sys.executable, "-m", "capture", *arguments]
    token = None if is_loopback(host) else secrets.token_urlsafe(24)
    server = GuardedServer(shlex.join(command), host, port, token, apps)
    logging.getLogger("textual-serve").setLevel(logging.WARNING)
    for noisy in ("aiohttp", "asyncio"):  # requests of strangers are answered, and no news
        logging.getLogger(noisy).setLevel(logging.CRITICAL)
    reached = reachable_address(host)
    shown = f"[{reached}]" if ":" in reached else reached
    address = f"http://{shown}:{port}/{f'?token={token}' if token else ''}"
    print(address, flush=True)
    if token:
        _show_phones(address)
    else:
        print(
            "Only this machine reaches it; --host 0.0.0.0 serves a phone as well. Ctrl-C ends it.",
            file=sys.stderr,
            flush=True,
        )
    with suppress(asyncio.CancelledError, KeyboardInterrupt):
        asyncio.run(server.run(listening))


def _show_phones(address: str) -> None:
    if sys.stderr.isatty() and "utf" in sys.stderr.encoding.lower():
        print(qr_code(address), file=sys.stderr)
    print(
        "Open this address on the phone, in the same network. Ctrl-C ends it.",
        file=sys.stderr,
        flush=True,
    )

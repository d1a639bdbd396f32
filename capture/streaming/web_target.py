"""The target that serves pictures over HTTP: a page with the picture and its controls, and the
stream by itself as MJPEG (multipart/x-mixed-replace), which browsers, OBS, VLC and OpenCV read.

Every request needs the token of the printed address. A viewer that is slow gets fewer pictures, and
one that takes nothing is disconnected; neither holds up the stream.
"""

import asyncio
import json
import logging
import secrets
import socket
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.extras import how_to_install
from calib.io.json_text import json_text
from capture.listening import open_sockets, reachable_address

try:
    from aiohttp import web

    from capture.guard import HEADERS, Guard
    from capture.guarded_server import CLOSING_S, guarded_server
except ImportError as error:
    raise InputError(f"--to http needs one more package: {how_to_install('serve')}") from error

WEB = Path(__file__).parents[1] / "web"
STREAM_COOKIE = "refracal-stream"
JPEG = [cv2.IMWRITE_JPEG_QUALITY, 85]
STALL_S = 10.0
"""The time in s after which a viewer that takes nothing is disconnected."""
MAX_VIEWERS = 16
MAX_REQUEST_BYTES = 1024


class WebTarget:
    def __init__(
        self,
        host: str,
        port: int,
        change: Callable[[Mapping[str, object]], object],
        state: Callable[[], Mapping[str, object]],
        tell: Callable[[str], object],
    ) -> None:
        """
        Args:
            host: the address to serve on.
            port: 0 for one that is free.
            change: called with the numbers that a person changes on the page; InputError says why
                that is impossible.
            state: returns what the page shows, as JSON.
            tell: gets the page's address, and sentences about viewers.
        """
        self._host = host
        self._port = port
        self._change = change
        self._state = state
        self._tell = tell
        self._guard = Guard(secrets.token_urlsafe(24), STREAM_COOKIE)
        self._viewers = 0
        self._jpeg = b""
        self._number = 0
        self._closing = False
        self._ready = threading.Event()

    @property
    def address(self) -> str:
        """The address of the page, with the token; known once entered."""
        reached = reachable_address(self._host)
        shown = f"[{reached}]" if ":" in reached else reached
        return f"http://{shown}:{self._port}/?token={self._guard.token}"

    def __enter__(self) -> Self:
        sockets = open_sockets(self._host, self._port, "port, as --to http:8081")
        self._port = sockets[0].getsockname()[1]
        for noisy in ("aiohttp", "asyncio"):  # requests of strangers are no news
            logging.getLogger(noisy).setLevel(logging.CRITICAL)
        self._thread = threading.Thread(target=self._run, args=(sockets,), name="http", daemon=True)
        self._thread.start()
        self._ready.wait()
        self._tell(f"The page with picture and controls: {self.address}")
        self._tell(f"The stream by itself: {self.address.replace('/?', '/stream.mjpg?')}")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._loop.call_soon_threadsafe(self._serving.cancel)
        self._thread.join(3 * CLOSING_S)

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Encode the picture if anybody looks at it."""
        if self._viewers:
            jpeg = cv2.imencode(".jpg", picture, JPEG)[1].tobytes()
            self._loop.call_soon_threadsafe(self._publish, jpeg)

    def _run(self, sockets: list[socket.socket]) -> None:
        try:
            asyncio.run(self._serve(sockets))
        finally:
            self._ready.set()  # whoever waits sees an error instead of nothing

    async def _serve(self, sockets: list[socket.socket]) -> None:
        self._loop = asyncio.get_running_loop()
        self._fresh = asyncio.Event()
        app = web.Application(client_max_size=MAX_REQUEST_BYTES)
        app.router.add_get("/", self._send_page)
        app.router.add_get("/stream.mjpg", self._send_stream)
        app.router.add_get("/state", self._send_state)
        app.router.add_post("/view", self._change_view)
        app.router.add_static("/page", WEB)
        async with guarded_server(app, sockets, self._guard) as self._serving:
            self._ready.set()
            with suppress(asyncio.CancelledError):
                await self._serving
            self._closing = True
            self._fresh.set()

    def _publish(self, jpeg: bytes) -> None:
        self._jpeg = jpeg
        self._number += 1
        self._fresh.set()

    async def _send_page(self, _: web.Request) -> web.StreamResponse:
        return web.FileResponse(WEB / "stream.html")

    async def _send_stream(self, request: web.Request) -> web.StreamResponse:
        if self._viewers >= MAX_VIEWERS:
            return web.Response(status=503, headers=HEADERS)
        response = web.StreamResponse(headers=HEADERS)
        response.content_type = "multipart/x-mixed-replace; boundary=picture"
        response.headers["Cache-Control"] = "no-store"
        self._viewers += 1
        try:
            await response.prepare(request)
            await response.write(b"--picture\r\n")
            await self._send_pictures(response)
        except TimeoutError:
            self._tell(f"A viewer took no picture for {STALL_S:.0f} s and is disconnected.")
            if request.transport:
                request.transport.abort()
        except ConnectionError:  # the viewer has gone
            pass
        finally:
            self._viewers -= 1
        return response

    async def _send_pictures(self, response: web.StreamResponse) -> None:
        """Send the newest picture again and again. The boundary follows at once, because a browser
        shows a picture when its boundary has come.
        """
        sent_number = self._number
        while not self._closing:
            if sent_number == self._number:
                self._fresh.clear()
                await self._fresh.wait()
                continue
            sent_number = self._number
            head = f"Content-Type: image/jpeg\r\nContent-Length: {len(self._jpeg)}\r\n\r\n"
            part = b"".join([head.encode(), self._jpeg, b"\r\n--picture\r\n"])
            await asyncio.wait_for(response.write(part), STALL_S)

    async def _send_state(self, _: web.Request) -> web.StreamResponse:
        return self._state_response()

    def _state_response(self) -> web.Response:
        return web.Response(text=json_text(self._state()), content_type="application/json")

    async def _change_view(self, request: web.Request) -> web.StreamResponse:
        try:
            values = await request.json()
            if not isinstance(values, dict):
                raise InputError("write an object with depth, crop or scale.")
            self._change(values)
        except (json.JSONDecodeError, UnicodeDecodeError, RecursionError):
            return web.json_response({"error": "The request is not JSON."}, status=400)
        except InputError as error:
            return web.json_response({"error": str(error)}, status=400)
        return self._state_response()

"""The terminal UI in a browser, for a phone or a laptop beside the camera.

Nobody but the person at this machine may drive a camera through it. On a loopback address the request must name that address, so that no
page of the web can reach it under another name; on any other address every request, the websocket's too, must bring the token that is
printed once, in its address or in the cookie that the first page leaves. A websocket is opened only by our own page.
"""

import hmac
import ipaddress
import logging
import secrets
import shlex
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from urllib.parse import urlsplit

from calib.errors import InputError

try:
    from aiohttp import web
    from textual_serve.server import Server
except ImportError as error:
    raise InputError("--serve needs one more package: pip install 'refracal[serve]'.") from error

COOKIE = "refracal"
FONTS = b"https://fonts.googleapis.com"
"""What the page would fetch from elsewhere: it works without, and a Pi may have no network."""
FITTED = b"""<style>.xterm .xterm-viewport { overflow-y: hidden; }</style><script>
const fits = Math.min(innerWidth / 80 / 0.61, innerHeight / 24 / 1.3);
document.getElementById("terminal").dataset.fontSize = Math.max(6, Math.min(16, Math.floor(fits)));
const waiting = setInterval(() => {
  const keys = document.querySelector(".xterm-helper-textarea");
  keys?.focus();
  if (keys && document.activeElement === keys) clearInterval(waiting);
}, 50);
</script></body>"""
"""Letters as large as leaves room for 80 columns and 24 rows, as on a phone that lies on its side; and keys work without a click."""
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class GuardedServer(Server):
    """textual-serve's server, behind the guard."""

    def __init__(self, command: str, host: str, port: int, token: str | None) -> None:
        """`token`: None serves a loopback address without one."""
        super().__init__(command, host, port, title="Refracal")
        self.token = token

    async def _make_app(self) -> web.Application:
        app = await super()._make_app()

        @web.middleware
        async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
            return await self._guard(request, handler)

        app.middlewares.append(guard)
        app.on_startup.clear()  # it would print a banner, with no token in its address
        return app

    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if not self._admits(request):
            return web.Response(status=403)
        self.public_url = f"{request.scheme}://{request.host}"  # as the browser knows it
        response = await handler(request)
        if request.path == "/" and isinstance(response, web.Response) and isinstance(response.body, bytes):
            page = b"".join(part for part in response.body.splitlines(keepends=True) if FONTS not in part)
            response.body = page.replace(b"</body>", FITTED)
            response.headers["Referrer-Policy"] = "no-referrer"
            response.headers["Cache-Control"] = "no-store"
            if self.token:
                response.set_cookie(COOKIE, self.token, httponly=True, samesite="Strict")
        return response

    def _admits(self, request: web.Request) -> bool:
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.host:
            return False
        if self.token is None:
            return request.host in {f"{name}:{self.port}" for name in ("127.0.0.1", "localhost", "[::1]", self.host)}
        brought = request.query.get("token") or request.cookies.get(COOKIE, "")
        return hmac.compare_digest(brought.encode(), self.token.encode())


def serve(session: Path, source: str, host: str, port: int) -> None:
    """Serve until Ctrl-C; InputError if the address cannot be used."""
    command = [sys.executable, "-m", "capture", "ui", str(session), *(["--source", source] if source else [])]
    token = None if _is_loopback(host) else secrets.token_urlsafe(24)
    server = GuardedServer(shlex.join(command), host, port, token)
    logging.getLogger("textual-serve").setLevel(logging.WARNING)
    shown = f"[{host}]" if ":" in host else host
    print(f"http://{shown}:{port}/{f'?token={token}' if token else ''}", flush=True)
    if token:
        print("Open this address on the phone, with this machine's own name or number in it. Ctrl-C ends it.", file=sys.stderr, flush=True)
    try:
        web.run_app(server._make_app(), host=host, port=port, print=None, access_log=None)  # a log would repeat the token
    except OSError as error:
        raise InputError(f"{host}:{port} cannot be served on ({error.strerror}): choose another --host or --port.") from error


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"

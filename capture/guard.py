"""The guard of a served page: which requests are answered, and the headers of every answer.

Whoever has the token may ask, in the address or in the cookie that the first page leaves. Without a
token, a request must name the address of this machine, so that no page of the web can reach the
server under another name. No page of another origin may ask.
"""

import hmac
from collections.abc import Collection
from dataclasses import dataclass
from urllib.parse import urlsplit

from aiohttp import web

HEADERS = {
    "X-Frame-Options": "DENY",
    "Content-Security-Policy": (
        "frame-ancestors 'none'; base-uri 'none'; object-src 'none'; script-src 'self'"
    ),
    "X-Content-Type-Options": "nosniff",
}
"""The headers of every answer: a page that framed ours could make a person press its keys, and no
script may run except those that we serve.
"""


@dataclass(frozen=True, slots=True)
class Guard:
    token: str | None
    """The text that a request must bring; None: a loopback address is served without one."""
    cookie: str
    """The name of the cookie that carries the token. Browsers share cookies between the ports of
    one host, so each server has its own name.
    """

    def admits(self, request: web.Request, hosts: Collection[str]) -> bool:
        """Return True if the request may be answered.

        Args:
            hosts: the values of the header Host that are allowed without a token.
        """
        origin = request.headers.get("Origin")
        try:
            if origin is not None and urlsplit(origin).netloc != request.host:
                return False
        except ValueError:  # the text is not an address
            return False
        if self.token is None:
            return request.host in hosts
        token = request.query.get("token") or request.cookies.get(self.cookie, "")
        return hmac.compare_digest(token.encode(errors="surrogateescape"), self.token.encode())

    def seal(self, request: web.Request, response: web.StreamResponse) -> None:
        """Add the headers to an answer that is not sent yet, and the cookie to the first page."""
        if not response.prepared:
            for name, value in HEADERS.items():
                response.headers.setdefault(name, value)
        if request.path.startswith("/page/"):
            # a file of an older version would not fit
            response.headers["Cache-Control"] = "no-cache"
        if request.path == "/":
            response.headers["Referrer-Policy"] = "no-referrer"
            response.headers["Cache-Control"] = "no-store"
            if self.token:
                response.set_cookie(self.cookie, self.token, httponly=True, samesite="Strict")

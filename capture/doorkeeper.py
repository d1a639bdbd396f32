"""Connections of strangers to the served screen: few at a time, and each for a few seconds.

Whoever keeps a connection open with half a request would else take one of the files that a process
may have open, until nobody else is answered.
"""

import asyncio
from collections import Counter

from aiohttp import web

STRANGER_S = 10.0
"""How long a connection may stay open before a request on it has been admitted: a phone's needs a
second.
"""
MOST_STRANGERS = 64
"""Such connections at a time; a process may have 1024 files open. A browser opens six at once."""
SWEEP_S = 0.5
"""Time between two looks at the connections."""


class Doorkeeper:
    """Makes the server's connections, and closes those on which no request was admitted in time.

    Where there are too many, the oldest one goes of the address that has the most, so that whoever
    comes is answered first.
    """

    def __init__(self, server: web.Server) -> None:
        self._server = server
        self._strangers: dict[web.RequestHandler, float] = {}
        """When each was opened, s of the loop's clock; the oldest first."""

    def __call__(self) -> web.RequestHandler:
        """Return the protocol of a connection that was just accepted."""
        connection: web.RequestHandler = self._server()
        self._strangers[connection] = asyncio.get_running_loop().time()
        self._limit()
        return connection

    def admit(self, connection: web.RequestHandler) -> None:
        """Let a connection stay open: a request on it was allowed."""
        self._strangers.pop(connection, None)

    async def watch(self) -> None:
        """Close what has been open for too long, until this is cancelled."""
        while True:
            await asyncio.sleep(SWEEP_S)
            self._limit()
            now = asyncio.get_running_loop().time()
            for connection, begun in list(self._strangers.items()):
                ended = connection.transport is None and begun < now - SWEEP_S
                if ended or begun < now - STRANGER_S:
                    self._close(connection)

    def _limit(self) -> None:
        """Close the oldest of those that are too many. One that is just being accepted has no
        transport yet, and is not counted.
        """
        addresses = {
            connection: str(connection.transport.get_extra_info("peername", ("",))[0])
            for connection in self._strangers
            if connection.transport
        }
        while len(addresses) > MOST_STRANGERS:
            ((most, _),) = Counter(addresses.values()).most_common(1)
            oldest = next(each for each, address in addresses.items() if address == most)
            del addresses[oldest]
            self._close(oldest)

    def _close(self, connection: web.RequestHandler) -> None:
        del self._strangers[connection]
        if connection.transport:
            connection.transport.abort()

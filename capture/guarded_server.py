"""A web server whose requests a guard admits, on sockets that are open already."""

import asyncio
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Sequence
from contextlib import asynccontextmanager

from aiohttp import web

from capture.doorkeeper import Doorkeeper
from capture.guard import HEADERS, Guard

CLOSING_S = 1.0
"""The time in s that requests have to end when the server does."""

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@asynccontextmanager
async def guarded_server(
    app: web.Application,
    sockets: Sequence[socket.socket],
    guard: Guard,
    hosts: Collection[str] = (),
) -> AsyncIterator[asyncio.Task[None]]:
    """Serve an app within the context, whose value is the task that serves.

    Args:
        guard: refuses requests without its token.
        hosts: the names of this server, where the guard has no token.
    """

    @web.middleware
    async def admit(request: web.Request, handler: Handler) -> web.StreamResponse:
        if not guard.admits(request, hosts):
            return web.Response(status=403, headers=HEADERS)
        door.admit(request.protocol)
        response = await handler(request)
        guard.seal(request, response)
        return response

    app.middlewares.append(admit)
    runner = web.AppRunner(app, access_log=None, shutdown_timeout=CLOSING_S)
    await runner.setup()
    assert runner.server
    door = Doorkeeper(runner.server)
    loop = asyncio.get_running_loop()
    servers = [await loop.create_server(door, sock=listening) for listening in sockets]
    try:
        yield loop.create_task(door.watch())
    finally:
        for server in servers:
            server.close()
        await runner.cleanup()

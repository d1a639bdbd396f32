"""Strangers' connections: closed in time, limited in number, and in nobody's way."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

import pytest

pytest.importorskip("textual_serve", reason="the extra `serve` is not installed")

from aiohttp import web

from capture import doorkeeper
from capture.doorkeeper import Doorkeeper

HALF_HEAD = b"GET / HTTP/1.1\r\nHost: x\r\nX-a: "
HALF_BODY = b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 100\r\n\r\nhalf"
OWNER = b"GET /owner HTTP/1.1\r\nHost: x\r\n\r\n"
Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]
Open = Callable[[bytes], Awaitable[Streams]]


@asynccontextmanager
async def serving() -> AsyncIterator[Open]:
    """A server that admits whoever asks for /owner; what opens connections to it."""
    application = web.Application()

    async def answer(request: web.Request) -> web.Response:
        if request.path != "/owner":
            return web.Response(status=403)
        door.admit(request.protocol)
        return web.Response(text="owner")

    application.router.add_route("*", "/{path:.*}", answer)
    runner = web.AppRunner(application, access_log=None)
    await runner.setup()
    assert runner.server
    door = Doorkeeper(runner.server)
    loop = asyncio.get_running_loop()
    listener = await loop.create_server(door, "127.0.0.1", 0)
    port = listener.sockets[0].getsockname()[1]
    watching = loop.create_task(door.watch())
    writers: list[asyncio.StreamWriter] = []

    async def opened(sent: bytes) -> Streams:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writers.append(writer)
        writer.write(sent)
        return reader, writer

    try:
        yield opened
    finally:
        watching.cancel()
        for writer in writers:
            writer.close()
        listener.close()
        await runner.cleanup()


async def rest(reader: asyncio.StreamReader) -> bytes:
    """Everything until the connection is closed, however that is done."""
    received = b""
    try:
        while piece := await reader.read(4096):
            received += piece
    except ConnectionError:
        pass
    return received


@pytest.mark.parametrize(
    ("sent", "answer"),
    [
        (b"", b""),
        (HALF_HEAD, b""),
        (HALF_BODY, b"403"),
        (b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", b"403"),
    ],
    ids=["nothing", "half a head", "half a body", "a whole request without the token"],
)
def test_connections_that_are_not_admitted_are_closed(
    sent: bytes, answer: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doorkeeper, "STRANGER_S", 0.3)
    monkeypatch.setattr(doorkeeper, "SWEEP_S", 0.05)

    async def run() -> None:
        async with serving() as opened:
            stranger, _ = await opened(sent)
            assert answer in await asyncio.wait_for(rest(stranger), 60)

    asyncio.run(run())


def test_the_owner_s_connection_stays_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doorkeeper, "STRANGER_S", 0.3)
    monkeypatch.setattr(doorkeeper, "SWEEP_S", 0.05)

    async def run() -> None:
        async with serving() as opened:
            owner, writer = await opened(OWNER)
            assert b"owner" in await owner.readuntil(b"owner")
            stranger, _ = await opened(b"")
            await asyncio.wait_for(rest(stranger), 60)  # as long as a stranger is suffered
            writer.write(OWNER)
            assert b"200" in await owner.readuntil(b"owner")

    asyncio.run(run())


def test_strangers_are_few_and_the_owner_comes_in_between() -> None:
    async def run() -> None:
        async with serving() as opened:
            strangers = [
                (await opened(HALF_HEAD))[0] for _ in range(doorkeeper.MOST_STRANGERS + 30)
            ]
            owner, _ = await opened(OWNER)
            assert b"owner" in await asyncio.wait_for(owner.readuntil(b"owner"), 60)
            for stranger in strangers[:30]:  # the oldest had to go, long before their time
                assert await asyncio.wait_for(rest(stranger), 60) == b""
            assert not strangers[-1].at_eof()

    asyncio.run(run())

"""The link between the app and a page for a thumb: nothing is sent before the page asks, pictures
come as fast as it draws them, and invalid requests do nothing.
"""

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("textual_serve", reason="the extra `serve` is not installed")

from aiohttp import ClientSession, ClientWebSocketResponse, WSMsgType

from capture.tui.camera import Preview
from capture.tui.cells import Mark
from capture.tui.phone import MAX_PENDING, stack_pictures
from tests.capture.recordings import noise, write_recording
from tests.capture.tui.test_serve import Served
from tests.capture.tui.test_session import FIXTURE


class Page:
    """The other end of the websocket."""

    def __init__(self, socket: ClientWebSocketResponse) -> None:
        self.screen: dict[str, Any] = {}
        self.frames: list[dict[str, Any]] = []
        self.jpegs: list[bytes] = []
        self.tones: list[str] = []
        self.terminal = b""
        self._socket = socket

    async def ask(self, **what: object) -> None:
        await self._socket.send_json(["phone", what])

    async def hear(self, until: Callable[[], bool]) -> None:
        async with asyncio.timeout(240):
            while not until():
                message = await self._socket.receive()
                if message.type is WSMsgType.BINARY:
                    if message.data[:1] == b"\xff":
                        self.jpegs.append(message.data)
                    else:
                        self.terminal += message.data
                    continue
                assert message.type is WSMsgType.TEXT, message
                kind, text = json.loads(message.data)
                if kind != "phone":
                    continue
                if "tone" in text:
                    self.tones.append(text["tone"])
                elif "marks" in text:
                    self.frames.append(text)
                else:
                    self.screen = text

    async def see(self, words: str) -> None:
        await self.hear(
            lambda: any(words in str(block.get("text")) for block in self.screen.get("blocks", ()))
        )

    def block(self, name: str) -> dict[str, Any]:
        return next(block for block in self.screen["blocks"] if block["name"] == name)


@asynccontextmanager
async def opened(served: Served) -> AsyncIterator[Page]:
    served.status("/")  # it has begun to listen
    async with (
        ClientSession() as session,
        session.ws_connect(f"http://127.0.0.1:{served.port}/ws", max_msg_size=0) as socket,
    ):
        yield Page(socket)


def tried(served: Served, story: Callable[[Page], Coroutine[None, None, None]]) -> None:
    async def whole() -> None:
        async with opened(served) as page:
            await story(page)

    try:
        asyncio.run(whole())
    finally:
        _, err = served.end()
    assert "Traceback" not in err


def test_a_form_is_filled_by_name_and_nonsense_is_passed_over(tmp_path: Path) -> None:
    async def story(page: Page) -> None:
        await page.hear(lambda: len(page.terminal) > 1000)
        assert not page.screen, "nothing before it is asked for"
        await page.ask(view=True)
        await page.see("a new session")
        drawn = len(page.terminal)
        screen = page.screen["screen"]
        assert [block["label"] for block in page.screen["blocks"] if block["kind"] == "field"][
            :2
        ] == ["pictures from", "copy settings from (optional)"]
        assert [key["label"] for key in page.screen["keys"]] == ["Start", "Help", "Quit"]
        assert page.block("columns")["half"]
        for nonsense in (
            {"press": "ctrl+c"},
            {"press": "f"},
            {"field": "columns", "choose": 2},
            {"field": "shape", "choose": 99},
            {"field": "shape", "text": "dome"},
            {"field": "nothing", "text": "x"},
            {"field": "columns", "text": 5},
            {"screen": "Other-1", "field": "rows", "text": "77"},
            {"view": "yes"},
            {},
        ):
            await page.ask(**{"screen": screen, **nonsense})
        await page.ask(screen=screen, field="columns", text="12\n\x1b[2J")
        await page.ask(
            screen=screen, field="shape", choose=page.block("shape")["options"].index("none")
        )
        await page.hear(
            lambda: (
                page.block("columns")["value"] == "12[2J"
                and "inner_radius_mm" not in str(page.screen["blocks"])
            )
        )
        assert page.block("rows")["value"] == "", "77 was for another screen"
        await page.ask(screen=screen, field="columns", look=True)
        await page.hear(lambda: page.screen["focus"] == "columns")
        assert page.block("columns")["wrong"]
        assert len(page.terminal) == drawn, "no terminal is drawn meanwhile"
        assert not page.block("columns")["suggestion"]
        options = page.block("shape")["options"]
        await page.ask(screen=screen, field="shape", choose=options.index("cone"))
        await page.hear(lambda: "inner_radius_mm" in str(page.screen["blocks"]))
        await page.ask(screen=screen, field="inner_radius_mm", look=True)
        await page.see("Inner radius in millimetres, at the height of the lens")
        await page.ask(screen=screen, field="shape", choose=options.index("dome"))
        await page.see("The cover in front of the camera: a dome.")
        assert "axis" not in page.block("hint")["text"], "a dome has none"
        await page.ask(screen=screen, field="source", text="fol")
        await page.hear(lambda: page.block("source")["suggestion"] == "folder:")
        drawn = len(page.terminal)
        await page.ask(view=False)
        await page.hear(lambda: len(page.terminal) > drawn + 1000)

    tried(Served(tmp_path / "session"), story)


@pytest.mark.slow
def test_pictures_come_as_fast_as_they_are_drawn(tmp_path: Path) -> None:
    recording = write_recording(tmp_path / "bare", noise(300, 1640, 1232)[:1] * 300, interval_s=0.1)
    session = tmp_path / "session"
    session.mkdir()
    (session / "session.yaml").write_text(
        (FIXTURE / "session.yaml").read_text().replace("820", "1640").replace("616", "1232")
    )

    async def story(page: Page) -> None:
        await page.ask(view=True)
        await page.see("continued")
        assert not page.jpegs
        await page.ask(screen=page.screen["screen"], press="ctrl+s")
        await page.hear(lambda: len(page.jpegs) == MAX_PENDING)
        await page.ask(screen=page.screen["screen"], press="a")
        await page.see("auto OFF")
        assert len(page.jpegs) == MAX_PENDING, "none is sent to a page that draws none"
        picture = cv2.imdecode(np.frombuffer(page.jpegs[-1], np.uint8), cv2.IMREAD_UNCHANGED)
        assert picture is not None
        assert picture.shape[:2] == (616, 820)
        assert (page.frames[-1]["width"], page.frames[-1]["height"]) == (1640, 1232)
        for number in range(MAX_PENDING, MAX_PENDING + 3):
            await page.ask(drawn=number)
            await page.hear(lambda number=number: len(page.jpegs) > number)  # type: ignore[misc]
        assert [frame["number"] for frame in page.frames] == list(range(1, len(page.frames) + 1))

    tried(Served(session, "--source", f"folder:{recording}"), story)


def test_marks_move_with_stacked_pictures() -> None:
    """A mark on a bright spot of its frame is on that spot of the stacked picture, for frames of
    other sizes, grey and in colour.
    """
    frames = [np.zeros((480, 640), np.uint8), np.zeros((600, 1200, 3), np.uint8)]
    spots = [(200, 120), (900, 420)]
    for frame, (x, y) in zip(frames, spots, strict=True):
        frame[y - 20 : y + 21, x - 20 : x + 21] = 255
    previews = [
        (Preview.of(frame, sharp=True), [Mark("+", np.array([spot], np.float64), label="a")])
        for frame, spot in zip(frames, spots, strict=True)
    ]
    image, (width, height), marks = stack_pictures(previews)
    assert (width, height) == (1200, 900 + 600)
    assert image.shape[1] / image.shape[0] == pytest.approx(width / height, rel=0.01)
    scale = width / image.shape[1]
    for mark, top, bottom in zip(marks, (0, 900), (900, 1500), strict=True):
        rows, columns = np.nonzero(image[round(top / scale) : round(bottom / scale), :, 0] > 127)
        centre = (np.array([columns.mean(), rows.mean()]) + 0.5) * scale - 0.5 + [0, top]
        np.testing.assert_allclose(mark.points[0], centre, atol=2 * scale)
        assert mark.label == "a"

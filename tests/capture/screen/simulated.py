"""A camera that photographs what a page shows, and a page without a browser that speaks as the real
one does.
"""

import asyncio
import base64
import json
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
from aiohttp import ClientSession, WSMsgType
from numpy.typing import NDArray

from calib.fringes.pattern import Screen, ScreenPattern
from calib.session.schema import Number
from calib.session.shutter import Shutter
from capture.frames import Frame
from capture.reader import Reader
from capture.screen.eye import Eye
from capture.screen.page import PatternPage
from capture.screen.points_session import PointsSession
from capture.screen.recording import ScreenRecording
from fixtures.screen import LitScreen, ScreenCamera

PITCH = 2.0e-4
SCREEN = Screen(420, 320, (PITCH, PITCH))
LAG_S = 0.01
"""s from a drawing to its light."""
PAUSE_S = 0.002
"""s between two exposures."""
PERIOD = 20.0
DARK = np.zeros((SCREEN.height, SCREEN.width), np.uint8)

Drawing = NDArray[np.uint8]


@dataclass
class Light:
    """What the screen has drawn, and since when."""

    lag_s: float = LAG_S
    drawings: list[tuple[float, Drawing]] = field(default_factory=list)

    def draw(self, drawing: Drawing) -> None:
        self.drawings = [*self.drawings[-3:], (time.monotonic(), drawing)]

    def at(self, time_s: float) -> Drawing:
        """Return what is lit at a time."""
        drawings = self.drawings
        drawn = [drawing for since, drawing in drawings if since + self.lag_s <= time_s]
        return drawn[-1] if drawn else DARK


class SimulatedCamera:
    """A live source whose camera stands before the screen, where `poses` says."""

    live = True
    remarks: Sequence[str] = ()
    shutter: Shutter | None = None

    def __init__(self, light: Light, poses: Sequence[ScreenCamera]) -> None:
        self.pose = 0
        """The number of the pose in which the screen stands now."""
        self._light = light
        self._poses = poses
        self._lit: dict[int, LitScreen] = {}
        self._last: tuple[int, Drawing, NDArray[np.float64]] | None = None
        self._closed = threading.Event()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._closed.set()

    def __iter__(self) -> Iterator[Frame]:
        rng = np.random.default_rng(3)
        sequence = 0
        while not self._closed.wait(PAUSE_S):
            number = self.pose % len(self._poses)
            if number not in self._lit:
                self._lit[number] = self._poses[number].lit_screen(SCREEN)
            lit = self._lit[number]
            time_s = time.monotonic()
            pixels = lit.expose(self._levels(number, self._light.at(time_s)), rng)
            yield Frame(pixels, sequence, time_s, {"exposure_us": 16667.0})
            sequence += 1

    def _levels(self, number: int, drawing: Drawing) -> NDArray[np.float64]:
        if self._last is None or self._last[0] != number or self._last[1] is not drawing:
            self._last = number, drawing, self._lit[number].levels(drawing)
        return self._last[2]


class StandIn:
    """A page without a browser. It measures the screen with a card, and presses Take."""

    def __init__(self, light: Light, on_show: Callable[[int], object] = lambda _: None) -> None:
        """`on_show` is called with the number of each pattern, before its answer."""
        self.sentences: list[str] = []
        self.size = SCREEN.size
        self.is_silent = False
        """True: it answers nothing more."""
        self._light = light
        self._on_show = on_show
        self._reopened = threading.Event()
        self._over = False

    @contextmanager
    def open(self, address: str) -> Iterator[Self]:
        """Open the page, and close it in the end."""
        thread = threading.Thread(target=lambda: asyncio.run(self._live(address)), daemon=True)
        thread.start()
        try:
            yield self
        finally:
            self._over = True
            thread.join(20)

    def reopen(self) -> None:
        """Close the page as a person does, and open it again."""
        self._reopened.set()

    async def _live(self, address: str) -> None:
        async with ClientSession() as session:
            while not self._over:
                self._reopened.clear()
                try:
                    await self._visit(session, address)
                except OSError:
                    await asyncio.sleep(0.02)

    async def _visit(self, session: ClientSession, address: str) -> None:
        base, _, token = address.partition("?")
        async with session.ws_connect(f"{base}screen?{token}") as page:
            await page.send_json({"screen": self._screen()})
            while not (self._over or self._reopened.is_set()):
                try:
                    message = await page.receive(0.02)
                except TimeoutError:
                    continue
                if message.type in (WSMsgType.CLOSE, WSMsgType.CLOSING, WSMsgType.CLOSED):
                    return
                if message.type == WSMsgType.TEXT:
                    answer = self._answer(json.loads(message.data))
                    await asyncio.sleep(self._light.lag_s)  # its word comes when it is true
                    if answer and not (self._reopened.is_set() or self.is_silent):
                        await page.send_json(answer)

    def _screen(self) -> dict[str, float]:
        return {"width": self.size[0], "height": self.size[1], "refresh_hz": 60.0}

    def _answer(self, message: Mapping[str, Any]) -> dict[str, object] | None:
        for key in ("sentence", "problem"):
            if message.get(key):
                self.sentences.append(message[key])
        match message:
            case {"show": int(number), "columns": str(columns), "rows": str(rows)}:
                lines = [
                    np.frombuffer(base64.b64decode(line), np.uint8) for line in (columns, rows)
                ]
                self._light.draw(ScreenPattern(lines[0], lines[1]).draw())
                self._on_show(number)
                return {"shown": number}
            case {"phase": "size"}:
                return {"card": {"px": [85.6e-3 / PITCH, 53.98e-3 / PITCH]}}
            case {"phase": "aim"}:
                return {"take": True}
        return None


@dataclass
class Told:
    """What a person is told."""

    sentences: list[str] = field(default_factory=list)
    poses: list[tuple[Path, str]] = field(default_factory=list)


@contextmanager
def recording(
    folder: Path,
    camera: SimulatedCamera,
    *,
    poses: int,
    told: Told,
    pitch: Number | None = None,
    period: float | None = PERIOD,
    port: int = 0,
) -> Iterator[tuple[ScreenRecording, PatternPage]]:
    """Open all that `capture --screen` opens."""
    with (
        PointsSession(folder) as session,
        Reader(camera) as reader,
        PatternPage("127.0.0.1", port) as page,
    ):

        def report(path: Path, sentence: str) -> None:
            told.poses.append((path, sentence))
            camera.pose += 1

        made = ScreenRecording(
            Eye(reader, page, lambda: False),
            session,
            poses,
            period=period,
            pitch=pitch,
            tell=told.sentences.append,
            report_pose=report,
        )
        yield made, page

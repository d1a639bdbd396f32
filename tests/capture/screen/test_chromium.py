"""A real browser's page, photographed by a simulated camera behind uneven glass."""

import asyncio
import base64
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("aiohttp", reason="the extra `serve` is not installed")

from calib.fringes.decode import ScreenPoints
from calib.session.shutter import Shutter
from capture.frames import Frame
from capture.reader import Reader
from capture.screen.eye import Eye
from capture.screen.page import PatternPage
from capture.screen.points_session import PointsSession
from capture.screen.recording import ScreenRecording
from fixtures.covered_screen import BINNING, SCREEN, CoveredCamera, place_errors_of
from fixtures.point_sessions import screen_scene
from fixtures.screen import LitScreen
from fixtures.synthetic import HEIGHT, WIDTH
from tests.capture.tui.browser import CHROMIUM, Browser, connected

pytestmark = [
    pytest.mark.skipif(
        CHROMIUM is None, reason="Chromium is not installed: apt-get install chromium"
    ),
    pytest.mark.slow,
]
POSES = 1
CLICK = "document.getElementById({name!r}).click()"
VISIBLE = "!document.getElementById({name!r}).hidden && !document.getElementById('panel').hidden"
FILL = """(() => {{ const {{ width, height }} = document.getElementById("card").elements;
width.value = {width}; height.value = {height};
document.querySelector("#card button").click(); }})()"""


class PageCamera:
    """A live source: a camera behind glass, before the page of a browser."""

    live = True
    remarks: Sequence[str] = ()
    shutter: Shutter | None = None

    def __init__(self, lit: Sequence[LitScreen], browser: Browser, lock: asyncio.Lock) -> None:
        self.pose = 0
        self._lit = lit
        self._browser = browser
        self._lock = lock
        self._loop = asyncio.get_running_loop()
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
        shown: tuple[str, LitScreen] | None = None
        levels = np.zeros(0)
        while not self._closed.wait(0.005):
            time_s = time.monotonic()
            lit = self._lit[self.pose % len(self._lit)]
            encoded = asyncio.run_coroutine_threadsafe(self._screenshot(), self._loop).result(60)
            if (encoded, lit) != shown:
                shown, levels = (encoded, lit), lit.levels(decoded(encoded))
            pixels = lit.expose(levels, rng)
            yield Frame(pixels, sequence, time_s, {"exposure_us": 16667.0})
            sequence += 1

    async def _screenshot(self) -> str:
        async with self._lock:
            message = await self._browser.do("Page.captureScreenshot", format="png")
        return str(message["data"])


def decoded(encoded: str) -> NDArray[np.uint8]:
    """Return the grey picture of a screenshot."""
    packed = np.frombuffer(base64.b64decode(encoded), np.uint8)
    picture = cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    assert picture.shape == (SCREEN.height, SCREEN.width)
    return np.asarray(picture, np.uint8)


def test_a_page_of_chromium_is_decoded_through_uneven_glass(tmp_path: Path) -> None:
    asyncio.run(_record(tmp_path))


async def _record(folder: Path) -> None:
    made = screen_scene(1, POSES, 16, 10)
    cameras = [
        CoveredCamera(
            width=WIDTH // BINNING,
            height=HEIGHT // BINNING,
            blur=1.0,
            jpeg=None,
            path=made.path,
            values=made.values,
            pose=pose,
        )
        for pose in made.poses
    ]
    lit = [camera.lit_screen(SCREEN) for camera in cameras]
    sentences: list[str] = []
    async with connected(folder / "profile") as socket:
        browser, lock = Browser(socket), asyncio.Lock()

        async def call(script: str) -> Any:
            async with lock:
                return await browser.evaluate(script)

        async def until(name: str) -> None:
            start_s = time.monotonic()
            while not await call(VISIBLE.format(name=name)):
                assert time.monotonic() - start_s < 120, (name, sentences)
                await asyncio.sleep(0.05)

        async def until_shown() -> None:
            while not await call("document.getElementById('panel').hidden"):
                await asyncio.sleep(0.05)

        await browser.do(
            "Emulation.setDeviceMetricsOverride",
            width=SCREEN.width,
            height=SCREEN.height,
            deviceScaleFactor=1,
            mobile=False,
        )
        camera = PageCamera(lit, browser, lock)
        with (
            PointsSession(folder / "session") as session,
            Reader(camera) as reader,
            PatternPage("127.0.0.1", 0) as page,
            ThreadPoolExecutor(1) as pool,
        ):

            def report(_: Path, sentence: str) -> None:
                sentences.append(sentence)
                camera.pose += 1

            recording = ScreenRecording(
                Eye(reader, page, lambda: False),
                session,
                POSES,
                period=None,
                pitch=None,
                tell=sentences.append,
                report_pose=report,
            )
            async with lock:
                await browser.arrive(page.address, "document.readyState === 'complete'")
            running = asyncio.get_running_loop().run_in_executor(pool, recording.run)
            await call(CLICK.format(name="full"))
            await until("size")
            pitch = SCREEN.pitch[0]
            width, height = round(85.60e-3 / pitch), round(53.98e-3 / pitch)
            await call(FILL.format(width=width, height=height))
            await until("aim")
            await call(CLICK.format(name="take"))
            await until_shown()
            async with lock:  # the browser is closed and opened in the middle of a pose
                await browser.arrive(page.address, "document.readyState === 'complete'")
            await call(CLICK.format(name="full"))
            for _ in range(POSES):
                await until("aim")
                await call(CLICK.format(name="take"))
                await until_shown()
            await asyncio.wait_for(running, 300)
        assert [line for line in browser.complaints if "fullscreen" not in line.lower()] == []
    print(*sentences, sep="\n")
    assert any("page was closed" in line or "opened anew" in line for line in sentences)
    scale = session.described.pitch.value / SCREEN.pitch[0] if session.described else 0.0
    assert abs(scale - 1) < 0.005
    for number in range(POSES):
        with np.load(folder / "session" / "points" / f"{number:04d}.npz") as arrays:
            target = arrays["target"] / scale
            points = ScreenPoints(arrays["pixels"], target, arrays["covariance"])
        errors = place_errors_of(made, number, points)
        print(
            f"pose {number}: {len(target)} points, {errors.rms_px:.4f} px,"
            f" {errors.deviation:.2f} sigma"
        )
        assert errors.rms_px < 0.02
        assert 0.8 < errors.deviation < 1.25

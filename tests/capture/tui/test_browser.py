"""A whole session in Chromium, by keys, as someone at a laptop beside the camera has it.

`REFRACAL_PICTURES=FOLDER python -m pytest tests/capture/tui/test_browser.py` keeps a picture of
every step there, to be looked at.
"""

import asyncio
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("textual_serve", reason="the extra `serve` is not installed")

from tests.capture.tui.browser import CHROMIUM, Browser, browsing
from tests.capture.tui.driving import CONE
from tests.capture.tui.test_serve import Served
from tests.capture.tui.test_session import FIXTURE

STRETCH = FIXTURE.parent / "stretch"
PAGES = ((790, 500), (1170, 740))
"""The window sizes in px: for 80 x 24 cells and a few more rows, and for 120 x 40."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None,
        reason="Chromium is not installed: apt-get install chromium shows it the screen",
    ),
]


@pytest.mark.parametrize("size", PAGES, ids=["80x24", "120x40"])
def test_from_nothing_to_maps_in_a_browser(size: tuple[int, int], tmp_path: Path) -> None:
    session = tmp_path / "session"
    served = Served(session)
    try:
        asyncio.run(_from_nothing(served.address, session, size, tmp_path))
    finally:
        served.end()


async def _from_nothing(address: str, session: Path, size: tuple[int, int], folder: Path) -> None:
    async with browsing(address, folder / "profile", size) as browser:
        await browser.see("Where pictures come from")
        await _keep(browser, size, "1-new")
        await browser.write(f"folder:{FIXTURE / 'bare'}")
        await browser.press("Tab", "Tab")
        for text in ("9", "9", "20"):
            await browser.write(text)
        await browser.press("Enter")
        await browser.see("cylinder")
        await browser.press("c", "Enter")  # the shape is a cone
        await browser.see("inner_radius_mm")
        await browser.press("Tab")
        for text in CONE:
            await browser.write(text)
        await _keep(browser, size, "2-set-up")
        await browser.press("^s")
        await browser.see("[WITHOUT COVER]")
        await browser.see("Press n, then put the cover on")
        await _keep(browser, size, "3-without-cover")
        await browser.press("n")
        await browser.see("NOW PUT THE COVER ON")
        await browser.write(f"folder:{FIXTURE}")
        await browser.press("^s")
        await browser.see("[THROUGH COVER]")
        await browser.see("Press f to fit")
        await browser.see("Enough")
        await _keep(browser, size, "4-through-cover")
        await browser.press("f")
        await browser.see("Joint fit")
        await _keep(browser, size, "5-fit")
        await browser.see("The error fell from 0.4")
        await _keep(browser, size, "6-results")
        await browser.press("e")
        await browser.see("Nothing found")
        await _keep(browser, size, "7-effects")
        await browser.press("Escape")
        await browser.see("Views, the worst first")
        await browser.press("x")
        await browser.see("Maps that undistort pictures")
        await browser.write("0.5 1")
        await browser.press("^s")
        await browser.see("Wrote rays.npz map_0.5m.npz map_1m.npz")
        await _keep(browser, size, "8-export")
        assert browser.complaints == []
    with np.load(session / "export" / "map_1m.npz") as maps:
        assert maps["map_x"].shape == (616, 820)


def test_a_stretched_print_is_found_in_a_browser(tmp_path: Path) -> None:
    session = tmp_path / "session"
    session.mkdir()
    shutil.copytree(STRETCH / "frames", session / "frames")
    shutil.copy(STRETCH / "session.yaml", session)
    served = Served(session, "--source", f"folder:{STRETCH}")
    try:
        asyncio.run(_stretch(served.address, PAGES[0], tmp_path))
    finally:
        served.end()
    assert (session / "export" / "map_1m.npz").exists()


async def _stretch(address: str, size: tuple[int, int], folder: Path) -> None:
    async with browsing(address, folder / "profile", size) as browser:
        await browser.see("continued")
        await browser.press("Enter")
        await browser.see("Press f to fit")
        await browser.press("f")
        await browser.see("Press e to find faults")
        await _keep(browser, size, "stretch-1-results")
        await browser.press("e")
        await browser.see("Diagnosis")
        await _keep(browser, size, "stretch-2-looking")
        await browser.see("Found: board_scale.")
        await _keep(browser, size, "stretch-3-found")
        await browser.press("Enter")
        await browser.see("effects found")
        await _keep(browser, size, "stretch-4-after")
        await browser.press("x")
        await browser.see("Maps that undistort pictures")
        await browser.write("1")
        await browser.press("^s")
        await browser.see("Wrote rays.npz map_1m.npz")
        assert browser.complaints == []


async def _keep(browser: Browser, size: tuple[int, int], name: str) -> None:
    if folder := os.environ.get("REFRACAL_PICTURES"):
        await asyncio.sleep(0.5)  # the last change is drawn
        await browser.picture(Path(folder) / f"{name}-{size[0]}.png")

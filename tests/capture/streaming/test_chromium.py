"""The page of a stream in a real browser: it shows the pictures, and its controls change them."""

import time
from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="the extra `serve` is not installed")

from calib.calibration import Calibration
from capture.streaming.view import StreamView
from tests.capture.streaming.listening import HANGS_S
from tests.capture.streaming.test_web_target import Served
from tests.capture.tui.browser import CHROMIUM
from tests.report.chrome import PHONE, Chrome, Page, open_chrome

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is not installed: apt-get install chromium"
)
SHOWN = "document.getElementById('picture').naturalWidth > 0"
PIXELS = """(() => {
const image = document.getElementById("picture");
const canvas = document.createElement("canvas");
canvas.width = image.naturalWidth; canvas.height = image.naturalHeight;
const context = canvas.getContext("2d");
context.drawImage(image, 0, 0);
const data = context.getImageData(0, 0, canvas.width, canvas.height).data;
const points = [[0.5, 0.5], [0.25, 0.5], [0.75, 0.5], [0.5, 0.3], [0.5, 0.7]];
return {size: [canvas.width, canvas.height], colours: points.map(([x, y]) => {
  const at = 4 * (Math.floor(y * canvas.height) * canvas.width + Math.floor(x * canvas.width));
  return [data[at + 2], data[at + 1], data[at]]; })}; })()"""
"""The size of the picture, and its BGR at five places."""
PLACES = ((0.5, 0.5), (0.25, 0.5), (0.75, 0.5), (0.5, 0.3), (0.5, 0.7))
TYPE = """(() => {{ const field = document.querySelector("[name={name}]");
field.focus(); field.value = "{value}"; field.blur();
field.dispatchEvent(new Event("change", {{bubbles: true}})); }})()"""


@pytest.fixture(scope="module")
def chrome(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    with open_chrome(tmp_path_factory.mktemp("profile")) as browser:
        yield browser


@pytest.mark.parametrize("size", [(1280, 900), PHONE], ids=["desk", "phone"])
def test_the_page_shows_the_straight_pictures_and_its_controls_change_them(
    chrome: Chrome,
    calibration: Calibration,
    pictures: list[np.ndarray],
    size: tuple[int, int],
) -> None:
    async def story(page: Page) -> None:
        expected = served.straightener.straighten(pictures[0]).copy()
        await check(page, expected)
        assert await page.until("document.querySelector('[name=depth]').value === '0.5'")
        label = "document.getElementById('depth-label').textContent"
        assert await page.call(label) == "depth, m"
        served.depth_image = "depth.png"
        await page.call(TYPE.format(name="depth", value="0.1"))
        await page.call(TYPE.format(name="scale", value="0.5"))
        view = StreamView(0.1, None, 0.5)
        await check(page, view.undistorter(calibration).undistort(pictures[0]))
        assert served.straightener.view == view
        assert await page.call(label) == "depth where unknown, m"
        await page.call(TYPE.format(name="depth", value="-1"))
        problem = "document.getElementById('problem').textContent"
        assert await page.until(f"{problem} !== ''")
        assert "write metres above 0" in await page.call(problem)
        wide = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        assert await page.call(wide) <= 0

    async def check(page: Page, expected: np.ndarray) -> None:
        """Wait until the page shows a picture, which may be on its way."""
        height, width = expected.shape[:2]
        wanted = [expected[int(y * height), int(x * width)].tolist() for x, y in PLACES]
        start_s = time.monotonic()
        while True:
            shown = await page.call(PIXELS)
            same_size = shown["size"] == [width, height]
            differences = np.abs(np.subtract(shown["colours"], wanted))
            if same_size and differences.max() < 25:  # grey levels, of the JPEG
                return
            assert time.monotonic() - start_s < HANGS_S, (shown, wanted)

    with Served(calibration, pictures[0]).running() as served:
        _, complaints, requests = chrome.visit(served.target.address, story, size, ready=SHOWN)
    refused = [line for line in complaints if "400 (Bad Request)" not in line]
    assert refused == []
    assert {request.split("/")[2] for request in requests} == {served.target.address.split("/")[2]}

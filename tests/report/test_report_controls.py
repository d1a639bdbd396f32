"""Controls of the report in a real browser: the buttons that copy commands, the camera of the
session in space, and the curve of sigma beside its map.
"""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("aiohttp", reason="the extra `serve`, which drives Chromium, is not installed")

from calib.calibration import Calibration
from tests.capture.tui.browser import CHROMIUM
from tests.report.chrome import PHONE, Chrome, Page, open_chrome
from tests.report.conftest import Reported
from tests.report.made import report_in

pytestmark = pytest.mark.skipif(
    CHROMIUM is None,
    reason="Chromium is not installed: apt-get install chromium shows the report to these tests",
)
BUTTON = "document.querySelector('header .copy')"
COMMAND = "document.querySelector('header .command code').textContent"
CLIPBOARD = "Object.defineProperty(navigator, 'clipboard', {{value: {{writeText: {write}}}}})"
CORNERS_IN_PICTURE = """(() => {
const {camera} = document.querySelector(".scene");
return POSES.flatMap((_, view) => boardOutline(view, DATA.figures.scene.half)
  .map(([x, y, z]) => new Libraries.THREE.Vector3(x, -y, -z).project(camera))
  .map(({x, y}) => [x, y])); })()"""
"""The corners of the boards in the scene's picture, which goes from -1 to 1."""


@pytest.fixture(scope="module")
def chrome(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    with open_chrome(tmp_path_factory.mktemp("profile")) as browser:
        yield browser


async def press_enter(page: Page) -> None:
    await page.call(f"{BUTTON}.focus()")
    key = {"key": "Enter", "code": "Enter", "windowsVirtualKeyCode": 13, "text": "\r"}
    await page.do("Input.dispatchKeyEvent", type="keyDown", **key)
    await page.do("Input.dispatchKeyEvent", type="keyUp", **key)


def test_the_next_command_is_copied_by_keyboard(
    chrome: Chrome, small_calibration: Calibration, tmp_path: Path
) -> None:
    async def story(page: Page) -> tuple[str, str]:
        await page.call(CLIPBOARD.format(write="async text => { window.copied = text; }"))
        await press_enter(page)
        assert await page.until(f"{BUTTON}.textContent === 'copied'")
        return await page.call("window.copied"), await page.call(COMMAND)

    html = report_in(tmp_path, small_calibration).read_text()
    (copied, command), complaints, requests = chrome.read(html, tmp_path, story)
    assert copied == command
    assert command.startswith("capture ")
    assert (complaints, requests) == ([], [])


def test_a_command_is_selected_if_the_browser_refuses_the_clipboard(
    chrome: Chrome, small_calibration: Calibration, tmp_path: Path
) -> None:
    async def story(page: Page) -> tuple[str, str]:
        await page.call(CLIPBOARD.format(write="async () => { throw new Error('refused'); }"))
        await page.call("document.execCommand = () => false; 0")
        await press_enter(page)
        assert await page.until(f"{BUTTON}.textContent === 'selected: press Ctrl+C'")
        return await page.call("String(getSelection())"), await page.call(COMMAND)

    html = report_in(tmp_path, small_calibration).read_text()
    (selected, command), complaints, _ = chrome.read(html, tmp_path, story)
    assert selected == command
    assert complaints == []


@pytest.mark.slow
def test_the_boards_fill_the_session_in_space(
    chrome: Chrome, reported: Reported, tmp_path: Path
) -> None:
    """From every place, all boards are in the picture, and they are as large as it allows."""

    async def story(page: Page) -> None:
        buttons = "[...document.querySelectorAll('#scene .buttons button')]"
        for name in ("whole", "from above", "from the side"):
            button = f"{buttons}.find(button => button.textContent === {json.dumps(name)})"
            await page.call(f"{button}.click()")
            corners = await page.call(CORNERS_IN_PICTURE)
            extremes = [(min(axis), max(axis)) for axis in zip(*corners, strict=True)]
            assert max(abs(end) for ends in extremes for end in ends) < 1, name
            assert max(high - low for low, high in extremes) > 1.3, name

    for size in ((1280, 900), PHONE):
        chrome.read(reported.html, tmp_path, story, size)


@pytest.mark.slow
@pytest.mark.parametrize(("depths", "curves"), [((0.5,), 1), ((0.3, 0.5, 0.9), 0)])
def test_maps_of_sigma_fill_their_row(
    chrome: Chrome,
    small_calibration: Calibration,
    tmp_path: Path,
    depths: tuple[float, ...],
    curves: int,
) -> None:
    """One or two maps leave room for the curve of sigma by depth, and their sliders move it."""

    async def story(page: Page) -> tuple[int, float]:
        curve = "#sigma [aria-label='standard deviation by depth']"
        count = await page.call(f'document.querySelectorAll("{curve}").length')
        free = await page.call(
            "(() => { const row = document.querySelector('#sigma .panels').getBoundingClientRect();"
            " const ends = [...document.querySelectorAll('#sigma .panel')]"
            ".map(panel => panel.getBoundingClientRect().right);"
            " return row.right - Math.max(...ends); })()"
        )
        return count, free

    html = report_in(tmp_path, small_calibration, depths=depths).read_text()
    (count, free), complaints, _ = chrome.read(html, tmp_path, story)
    assert count == curves
    assert abs(free) < 2
    assert complaints == []

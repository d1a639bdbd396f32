"""Draw docs/report.jpg: parts of the report of `calib demo` as Chromium shows them, on light and on
dark.

`python -m tests.report.picture` draws it in half a minute.
"""

from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from calib.cli import main as calib
from tests.report.chrome import RAYS, Page, open_chrome

OUTPUT = Path("docs/report.jpg")
SIZE = (760, 1250)
"""px: the width and the height of each half."""
HALVES = (("light", "#straight"), ("dark", "#scene"))
"""The colours of each half, and the section at its top."""


BOX = """(() => { const r = document.querySelector(".scene canvas").getBoundingClientRect();
return [r.left + r.width / 2, r.top + r.height / 2]; })()"""


async def show_rays(page: Page) -> None:
    """Point at one of the boards that stand about the middle of the scene."""
    x, y = await page.call(BOX)
    for step in range(-8, 9):
        await page.mouse("mouseMoved", x + 12 * step, y + 8 * step)
        if await page.call(RAYS):
            return


def main() -> None:
    with TemporaryDirectory() as place:
        demo = Path(place) / "demo"
        with redirect_stdout(StringIO()):
            calib(["demo", "-o", str(demo), "--json"])
        draw((demo / "calibration" / "report.html").read_text(encoding="utf-8"), OUTPUT)


def draw(html: str, out: Path) -> None:
    """Draw parts of a report beside each other."""
    halves = []
    with TemporaryDirectory() as place, open_chrome(Path(place) / "profile") as chrome:
        for scheme, section in HALVES:
            file = Path(place) / f"{scheme}.png"

            async def story(page: Page, section: str = section, file: Path = file) -> None:
                await page.do("Emulation.setScrollbarsHidden", hidden=True)
                await page.call("document.documentElement.style.scrollbarWidth = 'none'")
                await page.call(f"document.querySelector({section!r}).scrollIntoView()")
                if section == "#scene":
                    await show_rays(page)
                await page.picture(file)

            chrome.read(html, Path(place), story, SIZE, scheme)
            picture = cv2.imread(str(file))
            assert picture is not None
            halves.append(picture)
    cv2.imwrite(str(out), np.hstack(halves), [cv2.IMWRITE_JPEG_QUALITY, 80])


if __name__ == "__main__":
    main()

"""The page of `capture` on a phone that guides through the demo's session: a part of the README's
picture.

The camera sees the demo's board in front of the demo's wall: two of its pictures, one laid over the
other.
"""

import asyncio
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tests.capture.tui.test_serve import Served
from tests.capture.tui.touch import telephone

DEMO = Path(__file__).parents[1] / "calib" / "demo"
SIZE = (390, 640)
"""points: the size of the page."""
RECORDED, SEEN = 3, 9
"""The number of views in the session, and the view that the camera shows."""
PLAYED_S, PLAYED = 0.25, 900
"""s between two pictures of the camera, and their number."""
PAPER, INK = 100, 40
"""Grey levels: the board's paper is brighter, its squares are darker, and the background is
between them.
"""
SHADE = 0.9
"""The brightness of the wall behind the board."""
HAS_OUTLINE = 'Boolean(document.querySelector("#picture .hint:not(.halo)")?.getAttribute("d"))'
"""A script that returns true once the page shows where to hold the board."""
SETTLE_S = 10.0
"""s: by then the guide has counted the view that was taken last."""


def guiding_page() -> Image.Image:
    """Return the page once it knows how sure the maps are, and shows where to hold the board."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        session, camera = folder / "dive", folder / "camera"
        for place in (session, camera):
            (place / "frames").mkdir(parents=True)
            shutil.copy(DEMO / "session.yaml", place)
        frames = sorted((DEMO / "frames").glob("*.jpg"))
        for frame in frames[:RECORDED]:
            shutil.copy(frame, session / "frames")
        cv2.imwrite(str(folder / "seen.png"), in_front_of_wall(frames[SEEN]))
        rows = ["file,time_s"]
        for number in range(PLAYED):
            (camera / "frames" / f"{number:04d}.png").symlink_to(folder / "seen.png")
            rows.append(f"{number:04d}.png,{number * PLAYED_S:.2f}")
        (camera / "frames.csv").write_text("\n".join([*rows, ""]))
        served = Served(session, "--source", f"folder:{camera}?speed=1")
        try:
            asyncio.run(_photograph(served.address, folder))
        finally:
            served.end()
        return Image.open(folder / "page.png").convert("RGB")


def in_front_of_wall(frame: Path) -> NDArray[np.uint8]:
    """Return (h, w, 3) BGR: the board of a frame in front of the wall."""
    grey = cv2.imread(str(frame), cv2.IMREAD_GRAYSCALE)
    wall = cv2.imread(str(DEMO / "wall.jpg"))
    assert grey is not None
    assert wall is not None
    smooth = cv2.GaussianBlur(grey, (5, 5), 0)
    on_board = ((smooth > PAPER) | (smooth < INK)).astype(np.uint8)
    outlines = cv2.findContours(on_board, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    board = cv2.convexHull(max(outlines, key=cv2.contourArea))
    mask = np.zeros(grey.shape, np.float64)
    cv2.fillPoly(mask, [board], 1.0, cv2.LINE_AA)
    opacity = cv2.GaussianBlur(mask, (3, 3), 0)[..., None]
    scene = opacity * grey[..., None] + (1 - opacity) * SHADE * wall
    return np.clip(scene, 0, 255).astype(np.uint8)


async def _photograph(address: str, folder: Path) -> None:
    async with telephone(address, folder / "profile", SIZE) as phone:
        await phone.see("continued")
        await phone.press_until("ctrl+s", "Through cover")
        await phone.see(f"{RECORDED + 1} views")
        await phone.see("more view")
        await phone.see("The maps are likely off by")
        await phone.until(HAS_OUTLINE)
        await asyncio.sleep(SETTLE_S)
        await phone.picture(folder / "page.png")

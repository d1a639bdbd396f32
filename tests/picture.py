"""The README's picture: a wall under water, bent and straight, the screen that guides, and how the
error falls, beside OpenCV's; and the pictures of docs/tutorial.md. `python -m tests.picture`.

All figures in it are those of `calib demo`, and are printed. The screen is that of `capture` on the
same camera, once the guide has computed how sure the maps are.
"""

import asyncio
import json
import shutil
from contextlib import chdir, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
import pypdfium2
from numpy.typing import NDArray
from PIL import Image

from calib.calibration import Calibration
from calib.calibration_content import TITLES
from calib.cli import main as calib
from fixtures.wall import bend_of_joint
from tests.capture.tui.driving import running, see, shown, until
from tests.capture.tui.recording import Cells, draw
from tests.opencv_error import NEAR, demo_error_nearby, opencv_error, opencv_error_nearby

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

OUTPUT = Path("docs/picture.png")
TUTORIAL = Path("docs/tutorial")
BOARD_SCALE = 1.3
"""px for each point of the sheet, 1/72 inch."""
DEMO = Path("calib/demo").resolve()
WIDTH_PX = 1920
"""Twice the width at which pages show it."""
COLOURS = 256
RECORDED, SEEN = 4, 9
"""The views of the session on the screen, and the view that its camera shows."""
SCREEN = (96, 28)
PLAYED_S = 0.25
"""s between two pictures of the camera on the screen."""
PLAYED = 480
INK, FAINT = "#1e293b", "#64748b"
COLOURS_OF_BARS = ("#b0543a", "#3f7d58")
HEADING = 0.7
"""The space for the heading of the nearer boards, in bars."""
COEFFICIENTS = 14
"""Coefficients of the lens of OpenCV that is compared: all that it has."""


def main() -> None:
    with TemporaryDirectory() as folder:
        demo = Path(folder) / "demo"
        with redirect_stdout(StringIO()) as output:
            calib(["demo", "-o", str(demo), "--json"])
        result = json.loads(output.getvalue())
        before, after = demo / "wall.jpg", demo / "straight" / "wall.jpg"
        errors = [(TITLES[stage["name"]], stage["rms_px"]) for stage in result["stages"]]
        calibration = Calibration.load(demo / "calibration")
        opencv = f"OpenCV, {COEFFICIENTS} coefficients"
        errors = [(opencv, opencv_error(calibration, COEFFICIENTS)), errors[-1]]
        nearby = [
            (opencv, opencv_error_nearby(calibration, COEFFICIENTS)),
            (errors[-1][0], demo_error_nearby(calibration)),
        ]
        bends = bend_of_joint(before), bend_of_joint(after)
        shutil.copy(after, TUTORIAL / "straight.jpg")
        pictures = [cv2.imread(str(path))[..., ::-1] for path in (before, after)]  # type: ignore[index]
    screen = guiding_screen()
    for image, name in ((screen, "screen.png"), (printed_board(), "board.png")):
        image.quantize(COLOURS, dither=Image.Dither.NONE).save(TUTORIAL / name, optimize=True)
    figure, panels = plt.subplots(
        2,
        2,
        figsize=(10.5, 7.5),
        gridspec_kw={"wspace": 0.03, "hspace": 0.1, "height_ratios": [1.2, 1]},
    )
    figure.subplots_adjust(left=0.005, right=0.995, top=0.962, bottom=0.005)
    _show(panels[0, 0], pictures[0], f"Through the window: lines bend by {bends[0]:.0f} px")
    _show(panels[0, 1], pictures[1], f"Undistorted: straight to {bends[1]:.2f} px")
    _show(panels[1, 0], np.asarray(screen), "The screen shows where to hold the board")
    _bars(panels[1, 1], errors, nearby)
    figure.savefig(OUTPUT, dpi=WIDTH_PX / 10.5, facecolor="white")
    with Image.open(OUTPUT) as image:
        image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(OUTPUT, optimize=True)
    print(
        *(f"{name}: {error:.3f} px" for name, error in (*errors, *nearby)),
        f"bend {bends[0]:.1f} px, left {bends[1]:.2f} px",
        f"{OUTPUT.stat().st_size / 1e3:.0f} kB",
        sep="; ",
    )


def printed_board() -> Image.Image:
    """Return the sheet that `calib board` draws."""
    with TemporaryDirectory() as folder, redirect_stdout(StringIO()):
        calib(["board", "-o", folder])
        page = pypdfium2.PdfDocument(Path(folder) / "board.pdf")[0]
        image: Image.Image = page.render(scale=BOARD_SCALE).to_pil()
    return image.convert("RGB")


def guiding_screen() -> Image.Image:
    """Return the screen of `capture` that guides through the demo's session."""
    with TemporaryDirectory() as folder, chdir(folder):
        session, camera = Path("dive"), Path("camera")
        for place in (session, camera):
            (place / "frames").mkdir(parents=True)
            shutil.copy(DEMO / "session.yaml", place)
        names = sorted(path.name for path in (DEMO / "frames").glob("*.jpg"))
        for name in names[:RECORDED]:
            shutil.copy(DEMO / "frames" / name, session / "frames")
        rows = ["file,time_s"]
        for number in range(PLAYED):
            (camera / "frames" / f"{number:04d}.jpg").symlink_to(DEMO / "frames" / names[SEEN])
            rows.append(f"{number:04d}.jpg,{number * PLAYED_S:.2f}")
        (camera / "frames.csv").write_text("\n".join([*rows, ""]))
        return draw(asyncio.run(_guided(session)), SCREEN, 2)


async def _guided(session: Path) -> Cells:
    """Return the cells of the screen once the maps' accuracy is computed."""
    async with running(session, "folder:camera?speed=1", size=SCREEN) as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s", "a")
        await see(pilot, "auto OFF")
        await until(pilot, lambda: "still running" in shown(pilot) or "more view" in shown(pilot))
        await until(
            pilot,
            lambda: "Glass crossed" in shown(pilot) and "HOLD IT HERE" in shown(pilot),
        )
        await pilot.pause(1.0)
        return [list(strip) for strip in pilot.app.screen._compositor.render_strips()]


def _show(panel: Axes, picture: NDArray[Any], title: str) -> None:
    panel.imshow(picture, interpolation="lanczos")
    panel.set_title(title, fontsize=13, color=INK, pad=5)
    panel.set_axis_off()


def _bars(panel: Axes, errors: list[tuple[str, float]], nearby: list[tuple[str, float]]) -> None:
    """Draw the errors where the boards were, and below them those of nearer boards."""
    rows = (*errors, *nearby)
    places = [len(rows) + HEADING - i - HEADING * (i >= len(errors)) for i in range(len(rows))]
    sizes = [error for _, error in rows]
    longest = max(sizes)
    bars = panel.barh(places, sizes, color=2 * COLOURS_OF_BARS, height=0.3)
    panel.bar_label(bars, [f" {error:.3f} px" for error in sizes], fontsize=13, color=INK)
    for place, (name, _) in zip(places, rows, strict=True):
        panel.text(0.01 * longest, place + 0.2, name, fontsize=11, va="bottom", color=FAINT)
    top = places[len(errors)] + 0.62
    near = f"Error left nearer, at {NEAR[0]:g} to {NEAR[1]:g} m"
    panel.text(0.01 * longest, top, near, fontsize=13, va="bottom", color=INK)
    panel.set(
        xlim=(0, 1.36 * longest),
        ylim=(places[-1] - 0.35, places[0] + 0.7),
        xticks=[],
        yticks=[],
        box_aspect=0.583,
    )
    panel.set_title("Error left where the boards were", fontsize=13, color=INK, pad=5)
    panel.spines[["top", "right", "bottom"]].set_visible(False)
    panel.spines["left"].set_color(FAINT)


if __name__ == "__main__":
    main()

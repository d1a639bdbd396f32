"""The README's picture: a wall under water, bent and straight, the phone that guides, and the error
that is left, beside OpenCV's; the start page's picture for phones, which has no phone in it; and
the pictures of docs/tutorial.md. `python -m tests.picture` draws all of them in half a minute.

All figures in it are those of `calib demo` and of tests/opencv_error.py, and are printed. The page
and the screen are those of `capture` on the same camera, once the guide has computed how sure the
maps are.
"""

import asyncio
import json
import shutil
from contextlib import chdir, redirect_stdout
from dataclasses import dataclass
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
from calib.cli import main as calib
from fixtures.wall import bend_of_joint
from tests.capture.tui.driving import running, see, shown, until
from tests.capture.tui.recording import Cells, draw
from tests.opencv_error import (
    NEAR,
    error_nearby,
    fit_without_numbers,
    opencv_error,
    opencv_projection,
    refracal_projection,
)
from tests.phone_picture import guiding_page

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

OUTPUT = Path("docs/picture.png")
PHONE = Path("docs/picture-phone.png")
TUTORIAL = Path("docs/tutorial")
BOARD_SCALE = 1.3
"""px for each point of the sheet, 1/72 inch."""
DEMO = Path("calib/demo").resolve()
WIDTH_PX = 1920
"""Twice the width at which pages show it."""
PHONE_WIDTH_PX = 740
"""Twice the width at which phones show it."""
PHONE_WIDTH_INCHES = 370 / 72
"""The same width with an inch for 72 px of the page: a point of type is a pixel."""
PHONE_HEIGHT = 1.2
"""The height of the same picture over its width."""
COLOURS = 256
RECORDED, SEEN = 3, 9
"""The views of the session on the screen, and the view that its camera shows."""
SCREEN = (96, 28)
PLAYED_S = 0.25
"""s between two pictures of the camera on the screen."""
PLAYED = 480
INK, FAINT = "#1e293b", "#64748b"
COLOURS_OF_BARS = ("#b0543a", "#7fae93", "#3f7d58")
HEADING = 0.7
"""The space for the heading of the nearer boards, in bars."""
ROOM = 1.36
"""The width of the chart, in lengths of the longest bar: its label stands behind it."""
COEFFICIENTS = 14
"""Coefficients of the lens of OpenCV that is compared: all that it has."""


@dataclass(frozen=True)
class Errors:
    """The root mean square errors in px of the programs by name."""

    fitted: list[tuple[str, float]]
    """On the pictures that were fitted."""
    nearby: list[tuple[str, float]]
    """At NEAR."""
    noise: float
    """px, of the corners in the fitted pictures."""


def main() -> None:
    with TemporaryDirectory() as folder:
        demo = Path(folder) / "demo"
        with redirect_stdout(StringIO()) as output:
            calib(["demo", "-o", str(demo), "--json"])
        result = json.loads(output.getvalue())
        before, after = demo / "wall.jpg", demo / "straight" / "wall.jpg"
        calibration = Calibration.load(demo / "calibration")
        assert calibration.noise_px is not None
        unmeasured = fit_without_numbers(demo, Path(folder))
        names = (
            f"OpenCV, {COEFFICIENTS} coefficients",
            'Refracal, told "window, water"',
            "Refracal, told lens and window",
        )
        fitted = (
            opencv_error(calibration, COEFFICIENTS),
            unmeasured.stages[-1].rms_px,
            result["stages"][-1]["rms_px"],
        )
        nearby = (
            error_nearby(opencv_projection(calibration, COEFFICIENTS)),
            error_nearby(refracal_projection(unmeasured)),
            error_nearby(refracal_projection(calibration)),
        )
        errors = Errors(
            fitted=list(zip(names, fitted, strict=True)),
            nearby=list(zip(names, nearby, strict=True)),
            noise=calibration.noise_px,
        )
        bends = bend_of_joint(before), bend_of_joint(after)
        shutil.copy(after, TUTORIAL / "straight.jpg")
        pictures = [cv2.imread(str(path))[..., ::-1] for path in (before, after)]  # type: ignore[index]
    page = guiding_page()
    small = page.resize((page.width // 2, page.height // 2), Image.Resampling.LANCZOS)
    for image, name in (
        (guiding_screen(), "screen.png"),
        (printed_board(), "board.png"),
        (small, "phone.png"),
    ):
        image.quantize(COLOURS, dither=Image.Dither.NONE).save(TUTORIAL / name, optimize=True)
    draw_picture(pictures, bends, page, errors)
    draw_phone_picture(pictures, bends, errors)
    print(
        *(f"{name}: {error:.3f} px" for name, error in (*errors.fitted, *errors.nearby)),
        f"noise {errors.noise:.3f} px",
        f"bend {bends[0]:.1f} px, left {bends[1]:.2f} px",
        *(f"{path}: {path.stat().st_size / 1e3:.0f} kB" for path in (OUTPUT, PHONE)),
        sep="; ",
    )


def draw_picture(
    pictures: list[NDArray[Any]], bends: tuple[float, float], page: Image.Image, errors: Errors
) -> None:
    """Draw the four panels of OUTPUT."""
    figure = plt.figure(figsize=(10.5, 8.3))
    wall = figure.add_gridspec(1, 2, left=0.005, right=0.995, top=0.965, bottom=0.5, wspace=0.02)
    _show(
        figure.add_subplot(wall[0]), pictures[0], f"Through the window: bent by {bends[0]:.0f} px"
    )
    _show(figure.add_subplot(wall[1]), pictures[1], f"Undistorted: straight to {bends[1]:.2f} px")
    guide = figure.add_axes((0.005, 0.005, 0.345, 0.445))
    _show(guide, np.asarray(page), "Where to hold the board")
    _bars(figure.add_axes((0.385, 0.005, 0.61, 0.445)), errors)
    _save(figure, OUTPUT, WIDTH_PX)


def draw_phone_picture(
    pictures: list[NDArray[Any]], bends: tuple[float, float], errors: Errors
) -> None:
    """Draw the wall twice, and the errors below, for the width of a phone."""
    figure = plt.figure(figsize=(PHONE_WIDTH_INCHES, PHONE_HEIGHT * PHONE_WIDTH_INCHES))
    wall = figure.add_gridspec(1, 2, left=0, right=1, top=0.95, bottom=0.65, wspace=0.03)
    _show(figure.add_subplot(wall[0]), pictures[0], f"Bent by {bends[0]:.0f} px")
    _show(figure.add_subplot(wall[1]), pictures[1], f"Straight to {bends[1]:.2f} px")
    _bars(figure.add_axes((0.005, 0.005, 0.99, 0.59)), errors)
    _save(figure, PHONE, PHONE_WIDTH_PX)


def _save(figure: Figure, path: Path, width: int) -> None:
    """Write a figure as a small PNG, `width` px wide."""
    figure.savefig(path, dpi=width / figure.get_size_inches()[0], facecolor="white")
    with Image.open(path) as image:
        image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


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


def _bars(panel: Axes, errors: Errors) -> None:
    """Draw the errors where the boards were, and below them those of nearer boards."""
    rows = (*errors.fitted, *errors.nearby)
    count = len(errors.fitted)
    places = [len(rows) + HEADING - i - HEADING * (i >= count) for i in range(len(rows))]
    sizes = [error for _, error in rows]
    longest = max(sizes)
    bars = panel.barh(places, sizes, color=2 * COLOURS_OF_BARS, height=0.32)
    labels = [f" {error:.3f} px" for error in sizes]
    labels[count - 1] += f" (noise: {errors.noise:.3f})"
    panel.bar_label(bars, labels, fontsize=13, color=INK)
    for place, (name, _) in zip(places, rows, strict=True):
        panel.text(0.01 * longest, place + 0.2, name, fontsize=11, va="bottom", color=FAINT)
    top = places[count] + 0.62
    near = f"Error on nearer boards ({NEAR[0]:g} to {NEAR[1]:g} m)"
    panel.text(0.01 * longest, top, near, fontsize=13, va="bottom", color=INK)
    panel.set(
        xlim=(0, ROOM * longest),
        ylim=(places[-1] - 0.35, places[0] + 0.7),
        xticks=[],
        yticks=[],
    )
    panel.set_title(
        "Error on the fitted pictures", fontsize=13, color=INK, pad=5, loc="left", x=0.01 / ROOM
    )
    panel.spines[["top", "right", "bottom"]].set_visible(False)
    panel.spines["left"].set_color(FAINT)


if __name__ == "__main__":
    main()

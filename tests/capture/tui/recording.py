"""A film of the tests' own drive from nothing to maps, for docs/tui.md: `python -m
tests.capture.tui.recording [-o FILE.gif]`.

Every picture is drawn from the cells of the screen, as a terminal of 80x24 would; what takes long
is shown shorter.
"""

import argparse
import asyncio
from contextlib import chdir, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import matplotlib as mpl
from PIL import Image, ImageDraw, ImageFont
from rich.color import Color
from rich.segment import Segment
from textual._context import visible_screen_stack
from textual.app import App

from capture.tui.app import CaptureApp
from tests.capture.tui import driving, test_session
from tests.capture.tui.driving import SIZES

CELL = (8, 16)
"""The size of a letter, px."""
FONT = Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSansMono.ttf"
PAPER, INK = (18, 18, 18), (224, 224, 224)
EVERY_S = 0.15
SHORTEST_MS, LONGEST_MS, LAST_MS = 300, 1500, 4000
"""The limits for the duration of a still picture: a pressed key is visible, and a fit does not
bore.
"""
COLOURS = 48
Cells = list[list[Segment]]


class Camera:
    """A camera on the screen of whichever app is running; it keeps the changes."""

    def __init__(self) -> None:
        self.taken: list[tuple[Cells, int]] = []
        """The screens' cells, and how often each was seen in a row."""

    async def film(self, app: App[None]) -> None:
        while True:
            self.look(app)
            await asyncio.sleep(EVERY_S)

    def look(self, app: App[None]) -> None:
        visible_screen_stack.set(app._background_screens)
        with suppress(Exception):  # a screen may be on its way in or out
            cells = [list(strip) for strip in app.screen._compositor.render_strips()]
            if not any(segment.text.strip() for line in cells for segment in line):
                pass  # not drawn yet
            elif self.taken and self.taken[-1][0] == cells:
                self.taken[-1] = (cells, self.taken[-1][1] + 1)
            else:
                self.taken.append((cells, 1))


def draw(cells: Cells, size: tuple[int, int], scale: int = 1) -> Image.Image:
    """Half blocks as rectangles, so that pictures have no seams; everything else as letters. A
    larger scale draws more pixels.
    """
    wide, high = CELL[0] * scale, CELL[1] * scale
    font = ImageFont.truetype(str(FONT), 13 * scale)
    image = Image.new("RGB", (size[0] * wide, size[1] * high), PAPER)
    pen = ImageDraw.Draw(image)
    for row, segments in enumerate(cells):
        column = 0
        for text, style, _ in segments:
            front, back = (
                (rgb(style.color, INK), rgb(style.bgcolor, PAPER)) if style else (INK, PAPER)
            )
            if style and style.reverse:
                front, back = back, front
            for letter in text:
                x, y = column * wide, row * high
                pen.rectangle((x, y, x + wide - 1, y + high - 1), back)
                if letter == "▀":
                    pen.rectangle((x, y, x + wide - 1, y + high // 2 - 1), front)
                elif letter != " ":
                    pen.text((x, y), letter, front, font)
                column += 1
    return image


def rgb(colour: Color | None, usual: tuple[int, int, int]) -> tuple[int, int, int]:
    if colour is None or colour.is_default:
        return usual
    red, green, blue = colour.get_truecolor()
    return red, green, blue


def save(taken: list[tuple[Cells, int]], size: tuple[int, int], file: Path) -> None:
    """Write a GIF with one palette, so that unchanged pixels cost nothing."""
    images = [draw(cells, size) for cells, _ in taken]
    sheet = Image.new("RGB", (images[0].width, images[0].height * len(images[::4])))
    for index, image in enumerate(images[::4]):
        sheet.paste(image, (0, index * image.height))
    palette = sheet.quantize(COLOURS)
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    shown = [min(max(SHORTEST_MS, int(times * EVERY_S * 1000)), LONGEST_MS) for _, times in taken]
    shown[-1] = LAST_MS
    frames[0].save(
        file, save_all=True, append_images=frames[1:], duration=shown, loop=0, optimize=True
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/tui.gif"), metavar="FILE")
    output: Path = parser.parse_args().output.absolute()
    camera, filming = Camera(), []

    class Filmed(CaptureApp):
        def on_ready(self) -> None:
            filming.append(asyncio.create_task(camera.film(self)))

        def on_unmount(self) -> None:
            camera.look(self)  # the last words
            filming[-1].cancel()

    with TemporaryDirectory() as folder, chdir(folder), patch.object(driving, "CaptureApp", Filmed):
        Path("camera").symlink_to(test_session.FIXTURE)
        test_session.FIXTURE = Path("camera")  # so that no path of this machine is in the picture
        driving.drive(test_session._whole_session(SIZES[0], Path("session")))
    save(camera.taken, SIZES[0], output)
    print(f"{output}: {len(camera.taken)} pictures, {output.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()

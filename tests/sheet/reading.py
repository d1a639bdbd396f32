"""The written files read back: by a PDF reader, and as XML."""

import re
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
import pypdfium2
from numpy.typing import NDArray

from calib.sheet.checkerboard import CheckerboardPattern
from calib.sheet.layout import lay_out
from calib.sheet.paper import parse_paper
from calib.sheet.sheet import Sheet

MM = 25.4 / 72  # of a point
SVG = "{http://www.w3.org/2000/svg}"


@dataclass(frozen=True, slots=True)
class Raster:
    """A page as a printer has it before the ink."""

    grey: NDArray[np.uint8]
    mm: NDArray[np.float64]
    """The (2,) size of a pixel, across and down."""

    def place(self, pixels: NDArray) -> NDArray[np.float64]:
        """(..., 2) mm from the page's upper left of (..., 2) px."""
        return np.asarray((pixels + 0.5) * self.mm)


def made(paper: str, columns: int = 9, rows: int = 6, side: float | None = None) -> Sheet:
    sizes = parse_paper(paper)
    assert sizes
    return lay_out(CheckerboardPattern(columns, rows), sizes, side)


def rasterise(pdf: bytes, dpi: float = 300) -> Raster:
    page = pypdfium2.PdfDocument(pdf)[0]
    grey = np.asarray(page.render(scale=dpi / 72, grayscale=True).to_numpy(), np.uint8).squeeze()
    return Raster(grey, np.array(page.get_size()) * MM / grey.shape[::-1])


def exposed(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the picture of a camera that cuts off neither black nor white: a level that is cut off
    says nothing about a corner.
    """
    return np.asarray(25 + 0.8 * grey, np.uint8)


def words_of(pdf: bytes) -> list[tuple[str, NDArray[np.float64]]]:
    """Each stretch of text, and (4,) mm its left, upper, right and lower edge, as the reader finds
    them.
    """
    page = pypdfium2.PdfDocument(pdf)[0]
    text, height = page.get_textpage(), page.get_height()
    boxes = [text.get_rect(i) for i in range(text.count_rects())]
    return [
        (
            text.get_text_bounded(*box),
            np.array([box[0], height - box[3], box[2], height - box[1]]) * MM,
        )
        for box in boxes
    ]


def pdf_polygons(pdf: bytes) -> NDArray[np.float64]:
    """(polygons, 4, 2), as written."""
    outlines = re.findall(rb"^(.* h)$", pdf, re.MULTILINE)
    assert len(outlines) == 1
    numbers = [float(number) for number in re.findall(rb"-?[\d.]+", outlines[0])]
    return np.array(numbers).reshape(-1, 4, 2)


def svg_polygons(svg: str) -> NDArray[np.float64]:
    """(polygons, 4, 2), as written."""
    path = ElementTree.fromstring(svg).find(f"{SVG}path[@id='target']")
    assert path is not None
    return np.array(
        [float(number) for number in re.findall(r"-?[\d.]+", path.attrib["d"])]
    ).reshape(-1, 4, 2)

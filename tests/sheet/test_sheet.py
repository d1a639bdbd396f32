"""The printed board is where the sheet says that it is, at true scale, with rulers and words beside
it and not on it.
"""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from calib.corners.detect import find_corners
from calib.errors import InputError
from calib.session.board import Board
from calib.sheet.layout import PAPER_EDGE
from calib.sheet.pdf import to_pdf
from calib.sheet.sheet import Sheet
from calib.sheet.svg import to_svg
from tests.sheet.reading import (
    MM,
    SVG,
    exposed,
    made,
    pdf_polygons,
    rasterise,
    svg_polygons,
    words_of,
)

SHEETS = [
    ("A4", 9, 6, None),
    ("A4", 6, 9, None),
    ("A4", 9, 6, 25.0),
    ("A4", 3, 3, 12.5),
    ("A3", 9, 6, None),
    ("A3", 24, 17, None),
    ("Letter", 9, 6, None),
    ("Letter", 8, 11, 15.0),
    ("600x400", 14, 9, None),
    ("120x160", 5, 4, None),
]
"""Each paper, upright and across, with squares as large as they can be and given, with as little
white as there may be.
"""

each_sheet = pytest.mark.parametrize(("paper", "columns", "rows", "side"), SHEETS)


@each_sheet
def test_the_detector_finds_every_corner_where_the_sheet_says(
    paper: str, columns: int, rows: int, side: float | None
) -> None:
    """0.05 mm is a third of a pixel at 150 dpi; the largest that was seen is 0.0074 mm."""
    sheet = made(paper, columns, rows, side)
    raster = rasterise(to_pdf(sheet), 150)
    detection = find_corners(exposed(raster.grey), Board(columns, rows, sheet.side / 1000))
    assert detection
    error = np.linalg.norm(raster.place(detection.corners) - sheet.corners, axis=1)
    assert error.max() < 0.05, f"{error.max():.4f} mm"


@pytest.mark.parametrize(("columns", "rows", "side"), [(9, 6, 25.0), (9, 6, None), (6, 9, 26.0)])
def test_the_detector_finds_the_sheet_on_black(columns: int, rows: int, side: float | None) -> None:
    """A dark table begins at the edge of the paper: even the narrowest white margin is enough."""
    sheet = made("A4", columns, rows, side)
    raster = rasterise(to_pdf(sheet), 150)
    around = 100
    detection = find_corners(
        exposed(np.pad(raster.grey, around)), Board(columns, rows, sheet.side / 1000)
    )
    assert detection
    error = np.linalg.norm(raster.place(detection.corners - around) - sheet.corners, axis=1)
    assert error.max() < 0.05, f"{error.max():.4f} mm"


@each_sheet
def test_corners_are_the_boards_points(
    paper: str, columns: int, rows: int, side: float | None
) -> None:
    sheet = made(paper, columns, rows, side)
    corners = np.array(sheet.corners)
    assert (
        np.abs(corners - corners.mean(0) - Board(columns, rows, sheet.side).points()).max() < 1e-9
    )


@each_sheet
def test_both_files_have_the_same_shapes_at_the_same_scale(
    paper: str, columns: int, rows: int, side: float | None
) -> None:
    sheet = made(paper, columns, rows, side)
    pdf, svg = to_pdf(sheet), to_svg(sheet)
    assert np.array_equal(pdf_polygons(pdf), svg_polygons(svg))
    assert (
        np.abs(svg_polygons(svg) - np.array(sheet.polygons)).max() <= 0.5e-4 + 1e-9
    )  # the last digit that is written
    root = ElementTree.fromstring(svg)
    size = (sheet.paper.width, sheet.paper.height)
    assert [float(root.attrib[key].removesuffix("mm")) for key in ("width", "height")] == list(size)
    assert [float(number) for number in root.attrib["viewBox"].split()] == [0, 0, *size]
    box = re.search(rb"/MediaBox \[0 0 (\S+) (\S+)\]", pdf)
    assert box
    assert [float(number) * MM for number in box.groups()] == pytest.approx(size, abs=1e-4)


def test_the_pdf_s_table_leads_to_its_objects() -> None:
    """Readers repair a wrong one in silence, printers may not."""
    pdf = to_pdf(made("A4"))
    start = int(pdf.rsplit(b"startxref\n", 1)[1].split()[0])
    offsets = [
        int(offset) for offset in re.findall(rb"^(\d{10}) 00000 n $", pdf[start:], re.MULTILINE)
    ]
    assert [pdf[offset:].split(b" ", 1)[0] for offset in offsets] == [b"1", b"2", b"3", b"4", b"5"]
    length = re.search(rb"/Length (\d+) >>\nstream\n", pdf)
    assert length
    assert pdf[length.end() + int(length[1]) :].startswith(b"\nendstream")


@each_sheet
def test_words_are_text_inside_the_page_and_off_the_board(
    paper: str, columns: int, rows: int, side: float | None
) -> None:
    sheet = made(paper, columns, rows, side)
    stretches = words_of(to_pdf(sheet))
    text = " ".join(words for words, _ in stretches)
    a, b = sheet.rulers
    assert f"Checkerboard, {columns} × {rows} inner corners, squares of {sheet.side:g} mm." in text
    assert "Print at 100 %, no scaling." in text
    assert f"VALUE = {sheet.side:g} * (a / {a} + b / {b}) / 2" in " ".join(text.split())
    boxes = np.array([box for _, box in stretches])
    assert (boxes[:, :2] > PAPER_EDGE - 0.5).all(), (
        "letters reach over their own origin by some tenths of a mm"
    )
    assert (boxes[:, 2] < sheet.paper.width - PAPER_EDGE + 0.5).all()
    assert (boxes[:, 3] < sheet.paper.height - PAPER_EDGE + 1).all(), (
        "what hangs below the last line's baseline"
    )
    left_edge, right, top, bottom = _edges(sheet)
    is_beside = (
        (boxes[:, 2] < left_edge)
        | (boxes[:, 0] > right)
        | (boxes[:, 3] < top)
        | (boxes[:, 1] > bottom)
    )
    assert is_beside.all()


def test_both_files_have_the_same_words() -> None:
    sheet = made("A4")
    drawn = [text.text for text in ElementTree.fromstring(to_svg(sheet)).iter(f"{SVG}text")]
    shown = re.findall(rb"\((.*)\) Tj", to_pdf(sheet))
    assert drawn == [text.words for text in sheet.texts]
    assert drawn == [re.sub(rb"\\(.)", rb"\1", words).decode("cp1252") for words in shown]


@each_sheet
def test_rulers_have_their_stated_length(
    paper: str, columns: int, rows: int, side: float | None
) -> None:
    """Along each ruler: a tick every millimetre from 0 to its length, all off the board, and each
    number at its tick.
    """
    sheet = made(paper, columns, rows, side)
    stretches = [
        (words.split()[0], box.reshape(2, 2).mean(0))
        for words, box in words_of(to_pdf(sheet))
        if re.fullmatch(r"\d+\s*", words)
    ]
    lines = ElementTree.fromstring(to_svg(sheet)).iter(f"{SVG}line")
    ends = np.array(
        [
            [[float(line.attrib[f"{axis}{end}"]) for axis in "xy"] for end in (1, 2)]
            for line in lines
        ]
    )  # (lines, 2, 2)
    left_edge, _, _, bottom = _edges(sheet)
    for axis, length in enumerate(sheet.rulers):
        positions = ends[..., axis]
        ticks = ends[
            (positions[:, 0] == positions[:, 1]) & (np.abs(ends[:, 1] - ends[:, 0]).sum(-1) < 5)
        ]  # not the other ruler's whole length
        ours = ticks[ticks[:, 0, 1] > bottom] if axis == 0 else ticks[ticks[:, 0, 0] < left_edge]
        places = np.sort(ours[:, 0, axis])
        assert len(places) == length + 1
        assert (
            np.abs(places - places[0] - np.arange(length + 1)).max() < 1.1e-4
        )  # twice what the last digit rounds
        outward = 1 if axis == 0 else -1
        ruler_position = ours[0, 0, 1 - axis]
        numbers = {
            int(words): at[axis]
            for words, at in stretches
            if 0 < outward * (at[1 - axis] - ruler_position) < 6
        }
        assert set(numbers) >= set(range(0, length, 10))  # the last has its unit with it
        zero = places[0] if axis == 0 else places[-1]
        assert all(abs(at - zero - outward * number) < 0.3 for number, at in numbers.items()), (
            "a digit is 1 mm wide"
        )


@pytest.mark.parametrize("paper", ["A4", "A3", "Letter", "600x400", "160x120"])
def test_squares_are_as_large_as_a_wide_margin_allows(paper: str) -> None:
    sheet = made(paper)
    assert sheet.white >= sheet.side
    larger = made(paper, side=sheet.side + 1)
    assert larger.white < larger.side


def test_the_white_is_as_wide_as_the_sheet_says() -> None:
    """Nothing is printed so near to the board: measured on the picture."""
    sheet = made("A4", side=25.0)
    raster = rasterise(to_pdf(sheet))
    left_edge, right, top, bottom = _edges(sheet)
    y, x = np.nonzero(raster.grey < 128)
    ink = raster.place(np.stack([x, y], -1))
    distance = np.maximum.reduce(
        [left_edge - ink[:, 0], ink[:, 0] - right, top - ink[:, 1], ink[:, 1] - bottom]
    )
    distant = distance[distance > 0.1]
    assert distant.min() == pytest.approx(sheet.white, abs=0.15)  # a pixel and a line's half width
    assert min(left_edge, sheet.paper.width - right, top) >= sheet.white - 1e-9


@pytest.mark.parametrize(
    ("paper", "side", "says"),
    [
        (
            "A4",
            26.0,
            (
                "9x6 corners with squares of 26 mm have no room on A4 beside rulers and words: "
                "take squares of up to 25 mm, or up to 20 mm to have a white margin as wide as one."
            ),
        ),
        (
            "60x60",
            None,
            (
                "9x6 corners have no room on 60 × 60 mm beside rulers and words: take a larger"
                " --paper, or fewer corners."
            ),
        ),
    ],
)
def test_a_board_that_does_not_fit_gets_a_fitting_size(
    paper: str, side: float | None, says: str
) -> None:
    with pytest.raises(InputError) as refused:
        made(paper, side=side)
    assert str(refused.value) == says


def _edges(sheet: Sheet) -> tuple[float, float, float, float]:
    """mm, of the board: left, right, top and bottom."""
    points = np.array(sheet.polygons).reshape(-1, 2)
    return (
        float(points[:, 0].min()),
        float(points[:, 0].max()),
        float(points[:, 1].min()),
        float(points[:, 1].max()),
    )

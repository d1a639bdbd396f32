"""A picture in the cells of a terminal."""

import numpy as np
import pytest

from capture.tui.camera import PREVIEW_SIDE, Preview
from capture.tui.cells import CORNER_MARK, HINT_MARK, Mark, draw, fit_cells
from capture.tui.maps import shade_cells

SIZE = (160, 96)


@pytest.mark.parametrize(
    ("place", "expected"), [((48, 18), (48, 18)), ((80, 18), (48, 18)), ((48, 40), (48, 18))]
)
def test_a_picture_keeps_its_shape(place: tuple[int, int], expected: tuple[int, int]) -> None:
    assert fit_cells((1640, 1232), *place) == expected


def test_half_blocks_are_two_pixels_of_a_cell() -> None:
    grey = np.zeros((96, 160), np.uint8)
    grey[:12, 80:] = 255  # an eighth of the height: the upper half of the first row
    cells = draw(grey, SIZE, 8, 4, [], dots=False)
    assert cells.upper.tolist() == [[0] * 4 + [255] * 4] + [[0] * 8] * 3
    assert cells.lower.tolist() == [[0] * 8] * 4
    assert not cells.characters.astype(bool).any()


def test_dots_show_light_where_there_are_no_greys() -> None:
    grey = np.zeros((96, 160), np.uint8)
    grey[:, 80:] = 255
    cells = draw(grey, SIZE, 8, 4, [], dots=True)
    assert "".join(cells.characters[0]) == "⠀⠀⠀⠀⣿⣿⣿⣿"


@pytest.mark.parametrize("dots", [False, True])
def test_marks_stand_where_they_are(dots: bool) -> None:
    """Cells of 20 x 24 px: the corners at (50, 30) and (50, 55) are in column 2, rows 1 and 2."""
    grey = np.full((96, 160), 90, np.uint8)
    frame = Mark(
        HINT_MARK, np.array([[0.0, 0.0], [159, 0], [159, 95], [0, 95]]), closed=True, label="HERE"
    )
    found = np.array([[50.0, 30.0], [50.0, 55.0], [500.0, 30.0], [np.nan, 1.0]])
    cells = draw(
        grey,
        SIZE,
        8,
        4,
        [frame, Mark(CORNER_MARK, found)],
        dots=dots,
    )
    rows = [
        "".join(mark if mark in tuple("+▒HERE") else " " for mark in row)
        for row in cells.characters
    ]
    assert rows[0] == "▒" * 8 == rows[3]
    assert rows[1][0] == rows[2][7] == "▒"
    assert rows[1][1:6] == "HERE "  # the label says what to do: no mark covers it
    assert rows[2][2] == "+"


def test_a_preview_is_small_and_grey() -> None:
    preview = Preview.of(np.zeros((1232, 1640, 3), np.uint8))
    assert preview.grey.shape == (round(1232 * PREVIEW_SIDE / 1640), PREVIEW_SIDE)
    assert preview.size == (1640, 1232)


def test_shades_rise_with_coverage_and_full_means_enough() -> None:
    assert shade_cells(np.array([[0.0, 0.01, 0.3, 0.6, 0.8, 0.99, 1.0]]), 7, 1) == " ░░▒▓▓█"
    assert shade_cells(np.array([[0.0, 1.0], [1.0, 0.0]]), 4, 2) == "  ██\n██  "
    assert shade_cells(np.array([[np.nan]]), 2, 1) == "  "

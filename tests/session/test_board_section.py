"""The section `board`: three kinds, each read as it was written, and what is wrong said in one
sentence.
"""

import numpy as np
import pytest

from calib.errors import InputError
from calib.session.board import Board
from calib.session.board_section import board_to_yaml, read_board
from calib.session.coding import AprilGrid, Charuco
from calib.session.schema import Section

CHARUCO = {
    "type": "charuco",
    "columns": 9,
    "rows": 6,
    "square_mm": 20.0,
    "marker_mm": 15.0,
    "dictionary": "DICT_4X4_250",
}
GRID = {"type": "aprilgrid", "columns": 6, "rows": 5, "tag_mm": 88.0, "spacing": 0.3}

READ = [
    ({"columns": 9, "rows": 6, "square_mm": 20.0}, Board(9, 6, 0.02)),
    ({"type": "checkerboard", "columns": 9, "rows": 6, "square_mm": 20.0}, Board(9, 6, 0.02)),
    (CHARUCO, Board(9, 6, 0.02, coding=Charuco(0.015, "DICT_4X4_250"))),
    (
        {**CHARUCO, "legacy_pattern": True},
        Board(9, 6, 0.02, coding=Charuco(0.015, "DICT_4X4_250", legacy_pattern=True)),
    ),
    (GRID, Board(12, 10, 0.088, coding=AprilGrid(0.3))),
]


@pytest.mark.parametrize(
    ("written", "board"), READ, ids=["plain", "checkerboard", "charuco", "legacy", "aprilgrid"]
)
def test_a_board_is_read_and_written(written: dict[str, object], board: Board) -> None:
    assert read_board(Section(written, "session.yaml", "board")) == board
    assert read_board(Section(board_to_yaml(board), "session.yaml", "board")) == board


def test_a_tag_s_sigma_is_the_board_s() -> None:
    board = read_board(
        Section({**GRID, "tag_mm": {"value": 88.0, "sigma": 0.44}}, "session.yaml", "board")
    )
    assert board.relative_sigma == pytest.approx(0.005)
    read_back = read_board(Section(board_to_yaml(board), "session.yaml", "board"))
    assert read_back.square_sigma == board.square_sigma


def test_an_aprilgrid_s_corners_are_its_tags() -> None:
    """Two to a tag, the gap beside them; the board's middle is in the middle."""
    board = Board(4, 4, 0.1, coding=AprilGrid(0.5))
    grid = board.points().reshape(4, 4, 2)
    assert grid[0, :, 0] == pytest.approx([-0.125, -0.025, 0.025, 0.125])
    assert np.array_equal(grid[:, 0, 1], grid[0, :, 0])
    assert board.half == pytest.approx((0.125, 0.125))
    assert (str(board), board.cell) == ("2x2 AprilGrid", "tag")


WRONG: list[tuple[dict[str, object], str]] = [
    (
        {**CHARUCO, "type": "charucos"},
        'is the text "charucos": write charuco, or checkerboard, charuco, aprilgrid or gridboard',
    ),
    ({**CHARUCO, "marker_mm": 20.0}, "board.marker_mm is 20.0: write less than square_mm"),
    ({**CHARUCO, "marker_mm": 25}, "board.marker_mm is 25: write less than square_mm"),
    (
        {**CHARUCO, "dictionary": "DICT_4X4_25"},
        'board.dictionary is the text "DICT_4X4_25": write DICT_4X4_',
    ),
    (
        {**CHARUCO, "dictionary": "DICT_4X4_50", "columns": 12, "rows": 12},
        "board needs 84 markers where DICT_4X4_50 has 50",
    ),
    (
        {**CHARUCO, "legacy_pattern": "yes"},
        'board.legacy_pattern is the text "yes": write true or false',
    ),
    ({**CHARUCO, "tag_mm": 20.0}, "board.tag_mm is not a key of type charuco"),
    (
        {key: value for key, value in CHARUCO.items() if key != "dictionary"},
        "board.dictionary is missing: write one of OpenCV's names",
    ),
    ({**GRID, "spacing": 30}, "board.spacing is 30: write a number from 0.05 to 1"),
    (
        {**GRID, "columns": 25, "rows": 24},
        "board needs 600 markers where DICT_APRILTAG_36h11 has 587",
    ),
    ({**GRID, "square_mm": 20}, "board.square_mm is not a key of type aprilgrid"),
    (
        {"columns": 9, "rows": 6, "square_mm": 20.0, "marker_mm": 15.0},
        "board.marker_mm is not a known key",
    ),
]


@pytest.mark.parametrize(("written", "says"), WRONG, ids=range(len(WRONG)))
def test_errors_of_the_board_section_get_a_sentence(written: dict[str, object], says: str) -> None:
    with pytest.raises(InputError) as caught:
        read_board(Section(written, "session.yaml", "board"))
    assert says in str(caught.value), caught.value
    assert "\n" not in str(caught.value)

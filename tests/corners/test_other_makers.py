"""Boards of other makers: other first numbers, borders and orders, white on black, and OpenCV's
GridBoard.
"""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.corners.detection import Detection, NotFound
from calib.corners.find import find_board
from calib.corners.other_coding import other_coding
from calib.errors import InputError
from calib.session.board import Board
from calib.session.board_section import board_to_yaml, read_board
from calib.session.coding import AprilGrid, Charuco, grid_board
from calib.session.schema import Section

CELL = 96
"""px of the sheet: a square, or a tag."""
SIZE = (800, 600)
CAMERA = np.array([[750.0, 0, 403], [0, 750, 296], [0, 0, 1]])
CHARUCO = Board(6, 4, 0.03, coding=Charuco(0.0225, "DICT_4X4_250"))
KALIBR = Board(8, 6, 0.04, coding=AprilGrid(0.25))
GRID = Board(8, 6, 0.04, coding=grid_board(0.25, "DICT_5X5_100"))


def with_coding(board: Board, **changes: object) -> Board:
    assert board.coding
    return replace(board, coding=replace(board.coding, **changes))  # type: ignore[arg-type]


def sheet(board: Board) -> NDArray[np.uint8]:
    """The board, its middle in the sheet's middle."""
    coding = board.coding
    assert coding
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, coding.dictionary))
    if isinstance(coding, Charuco):
        size = (board.columns + 1, board.rows + 1)
        numbers = np.arange(size[0] * size[1] // 2) + coding.first_marker
        drawn = cv2.aruco.CharucoBoard(size, 1.0, coding.marker / board.square, dictionary, numbers)
        image = drawn.generateImage((size[0] * CELL, size[1] * CELL), None, 0, 1)
    else:
        image = _grid_sheet(board, coding, dictionary)
    image = cv2.copyMakeBorder(image, CELL, CELL, CELL, CELL, cv2.BORDER_CONSTANT, value=255)
    return np.asarray(255 - image if coding.inverted else image, np.uint8)


def _grid_sheet(
    board: Board, coding: AprilGrid, dictionary: cv2.aruco.Dictionary
) -> NDArray[np.uint8]:
    columns, rows, gap = board.columns // 2, board.rows // 2, round(CELL * coding.spacing)
    image = np.full((rows * (CELL + gap) + gap, columns * (CELL + gap) + gap), 255, np.uint8)
    for row in range(rows + 1):
        for column in range(columns + 1):
            y, x = row * (CELL + gap), column * (CELL + gap)
            if coding.crossings:
                image[y : y + gap, x : x + gap] = 0
            if row < rows and column < columns:
                line = row if coding.numbered_from == "upper_left" else rows - 1 - row
                number = coding.first_marker + line * columns + column
                tag = dictionary.generateImageMarker(number, CELL, None, coding.border)
                image[y + gap : y + gap + CELL, x + gap : x + gap + CELL] = np.rot90(
                    tag, -coding.rotation_deg // 90
                )
    return image


@cache
def views(board: Board) -> list[tuple[NDArray[np.uint8], NDArray[np.float64]]]:
    """Pictures of the board, and the (count, 2) px at which it has its corners."""
    drawn = sheet(board)
    metre = CELL / board.square  # px
    to_board = np.array(
        [[1 / metre, 0, -drawn.shape[1] / 2 / metre], [0, 1 / metre, -drawn.shape[0] / 2 / metre]]
    )
    results = []
    for k, tilt in enumerate([(0.3, 0.2), (-0.3, 0.3), (0.1, -0.4)]):
        rotation = cv2.Rodrigues(np.array([*tilt, 0.1 * k]))[0]
        homography = CAMERA @ np.column_stack([rotation[:, :2], (0, 0, 0.35)])
        full = homography @ np.vstack([to_board, [0, 0, 1]])
        pixel = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # centres to edges
        fine = np.diag([4.0, 4, 1]) @ pixel @ full
        fine[:2] -= 0.5 * fine[2]
        large = cv2.warpPerspective(
            drawn, fine @ pixel, (4 * SIZE[0], 4 * SIZE[1]), borderValue=90, flags=cv2.INTER_LINEAR
        )
        small = cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA).astype(np.float64)
        noise = np.random.default_rng(k).normal(0, 1, small.shape)
        picture = cv2.GaussianBlur(small * 0.8 + 20, (0, 0), 0.6) + noise
        points = np.column_stack([board.points(), np.ones(board.count)]) @ homography.T
        results.append(
            (np.asarray(np.clip(picture, 0, 255), np.uint8), points[:, :2] / points[:, 2:])
        )
    return results


BOARDS = {
    "kalibr": KALIBR,
    "gridboard": GRID,
    "charuco": CHARUCO,
    "charuco from 17": with_coding(CHARUCO, first_marker=17),
    "charuco from 100, inverted": with_coding(CHARUCO, first_marker=100, inverted=True),
    "inverted": with_coding(CHARUCO, inverted=True),
    "aprilgrid from 40": with_coding(KALIBR, first_marker=40),
    "one cell": with_coding(KALIBR, border=1),
    "from the top": with_coding(KALIBR, numbered_from="upper_left"),
    "as OpenCV draws tags": with_coding(
        KALIBR, border=1, numbered_from="upper_left", rotation_deg=0
    ),
    "aprilgrid inverted": with_coding(KALIBR, inverted=True),
    "gridboard from 30": with_coding(GRID, first_marker=30),
    "gridboard inverted": with_coding(GRID, inverted=True),
}
ADVICE = {
    "charuco from 17": ["numbers 17 to 33", "board.first_marker: 17 in"],
    "charuco from 100, inverted": ["board.first_marker: 100, board.inverted: true"],
    "inverted": ["printed white on black: write board.inverted: true in"],
    "aprilgrid from 40": ["numbers 40 to 51", "board.first_marker: 40"],
    "one cell": ["black border of one cell: write board.border_cells: 1"],
    "from the top": ["numbered from the upper left: write board.numbered_from: upper_left"],
    "as OpenCV draws tags": [
        "board.border_cells: 1, board.numbered_from: upper_left, board.tag_rotation_deg: 0"
    ],
    "aprilgrid inverted": ["board.inverted: true"],
    "gridboard from 30": ["numbers 30 to 41", "board.first_marker: 30"],
    "gridboard inverted": ["board.inverted: true"],
}


@pytest.mark.parametrize("name", BOARDS)
def test_a_board_that_is_declared_is_measured(name: str) -> None:
    board = BOARDS[name]
    for picture, truth in views(board):
        found = find_board(picture, board)
        assert isinstance(found, Detection), found
        seen = np.isfinite(found.corners[:, 0])
        assert seen.mean() > 0.9
        errors = np.linalg.norm(found.corners - truth, axis=1)[seen]
        assert np.sqrt((errors**2).mean()) < 0.15, "of a sheet that was resampled"
        assert (found.blurs[seen] > 0).all()
        assert (np.linalg.eigvalsh(found.covariances[seen]) > 0).all()


@pytest.mark.parametrize("name", ADVICE)
def test_the_keys_to_write_are_named(name: str) -> None:
    board = BOARDS[name]
    grid = GRID if "gridboard" in name else KALIBR
    declared = CHARUCO if isinstance(board.coding, Charuco) else grid
    pictures = [picture for picture, _ in views(board)]
    assert all(isinstance(find_board(picture, declared), NotFound) for picture in pictures)
    advice = other_coding(pictures, declared)
    for words in ADVICE[name]:
        assert words in advice
    assert advice.endswith(" in session.yaml.")
    assert other_coding(pictures, board) == ""


@pytest.mark.parametrize("name", BOARDS)
def test_the_section_is_read_as_it_was_written(name: str) -> None:
    assert read_board(Section(board_to_yaml(BOARDS[name]), "file", "board")) == BOARDS[name]


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("first_marker", -1, "board.first_marker is -1: write a whole number from 0"),
        ("first_marker", 580, "needs 12 markers from 580 on where DICT_APRILTAG_36h11 has 587"),
        ("border_cells", 3, "board.border_cells is 3: write one of 1, 2"),
        ("numbered_from", "upper left", "write upper_left, or one of lower_left, upper_left"),
        ("inverted", 1, "board.inverted is 1: write true or false"),
        ("tag_rotation_deg", 45, "write one of 0, 90, 180, 270"),
    ],
)
def test_a_wrong_key_is_refused(key: str, value: object, says: str) -> None:
    section = Section({**board_to_yaml(KALIBR), key: value}, "file", "board")
    with pytest.raises(InputError, match=says):
        read_board(section)

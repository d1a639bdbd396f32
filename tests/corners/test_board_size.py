"""The size of a board that nobody declared: found where there is one, and never made of chance."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calib.corners.board_size import ShownSize, shown_size
from calib.session.board import Board
from tests.corners.test_detect import Scene

Picture = NDArray[np.uint8]
BOARDS = ((8, 6), (11, 8), (5, 4), (9, 9))


def boards(columns: int, rows: int, size: tuple[int, int], blur: float = 0) -> list[Picture]:
    scene = Scene(
        board=Board(columns, rows, 1.0),
        size=size,
        focal=0.78 * size[0],
        distance=1.7 * (columns + 3),
        margin=1.5,
    )
    pictures = [
        replace(scene, roll=0.1 * k, tilt=(0.4 - 0.1 * k, 0.3), seed=k).draw()[0] for k in range(6)
    ]
    return [
        np.asarray(cv2.GaussianBlur(p, (0, 0), blur), np.uint8) if blur else p for p in pictures
    ]


@pytest.mark.parametrize(
    ("columns", "rows", "size"),
    [
        *((*board, size) for board in BOARDS for size in ((320, 240), (960, 720))),
        pytest.param(8, 6, (2592, 1944), marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_the_size_of_a_board_is_found(columns: int, rows: int, size: tuple[int, int]) -> None:
    answer = shown_size(boards(columns, rows, size))
    assert answer
    assert (answer.columns, answer.rows) == (columns, rows)


def test_a_board_out_of_focus_has_its_size_or_none() -> None:
    for blur in (2, 4, 8, 12):
        answer = shown_size(boards(8, 6, (960, 720), blur))
        assert answer is None or (answer.columns, answer.rows) == (8, 6), blur


def test_a_small_board_needs_more_pictures() -> None:
    pictures = boards(4, 3, (640, 480))
    assert shown_size(pictures) == ShownSize(4, 3, (0, 1, 2, 3, 4), 5)
    wall = np.full_like(pictures[0], 100)
    assert shown_size([*pictures[:3], wall, wall, wall]) is None


def test_pictures_that_do_not_agree_prove_nothing() -> None:
    two = boards(8, 6, (640, 480))[:2]
    assert shown_size([*two, *boards(7, 5, (640, 480))[:2]]) is None
    assert shown_size([*two, *[np.full_like(two[0], 100)] * 4]) == ShownSize(8, 6, (0, 1), 6)
    assert shown_size([two[0], *[np.full_like(two[0], 100)] * 4]) is None


def test_a_board_that_is_cut_off_has_no_size() -> None:
    pictures = [picture[:, 420:] for picture in boards(9, 6, (960, 720))]
    assert shown_size(pictures) is None


def gravel(random: np.random.Generator, size: int) -> Picture:
    places = random.uniform(0, 1, (640 * 480 // size**2, 2)) * [640, 480]
    grid = np.stack(np.meshgrid(np.arange(640), np.arange(480)), -1).reshape(-1, 2)
    distances, stones = map(np.asarray, cKDTree(places).query(grid, k=2))
    light = random.uniform(40, 220, len(places))[stones[:, 0]]
    light *= np.clip((distances[:, 1] - distances[:, 0]) / 4, 0.2, 1)
    return np.asarray(light.reshape(480, 640), np.uint8)


def text(random: np.random.Generator, size: int) -> Picture:
    page = np.full((480, 640), 230, np.uint8)
    for y in range(10, 480, size):
        line = "".join(random.choice(list("abcdefgHIKLMxyz 0123456789#%&"), 80))
        cv2.putText(page, line, (5, y), cv2.FONT_HERSHEY_SIMPLEX, size / 30, 30, 1, cv2.LINE_AA)
    return page


def threads(random: np.random.Generator, size: int) -> tuple[NDArray, NDArray]:
    """The signs of two crossing gratings on a cloth that is turned and not flat."""
    y, x = np.indices((480, 640))
    turn = random.uniform(-0.4, 0.4)
    u = x * np.cos(turn) + y * np.sin(turn) + 4 * np.sin(y / 60)
    v = y * np.cos(turn) - x * np.sin(turn)
    return np.sign(np.sin(np.pi * u / size)), np.sign(np.sin(np.pi * v / size))


def gingham(random: np.random.Generator, size: int) -> Picture:
    warp, weft = threads(random, size)
    return np.asarray(128 + 50 * warp + 50 * weft, np.uint8)


def chequered_cloth(random: np.random.Generator, size: int) -> Picture:
    warp, weft = threads(random, size)
    return np.asarray(128 + 90 * warp * weft, np.uint8)


def cells(random: np.random.Generator, size: int) -> Picture:
    black = random.integers(0, 2, (480 // size + 1, 640 // size + 1)) * 180 + 30
    return np.asarray(np.kron(black, np.ones((size, size), int))[:480, :640], np.uint8)


@pytest.mark.parametrize(
    "size", [24, *(pytest.param(size, marks=pytest.mark.slow) for size in (12, 40))]
)
@pytest.mark.parametrize("texture", [gravel, text, gingham, chequered_cloth, cells])
def test_textures_have_no_board(texture, size: int) -> None:  # type: ignore[no-untyped-def]
    random = np.random.default_rng(size)
    blurred = [cv2.GaussianBlur(texture(random, size), (0, 0), 0.8) for _ in range(6)]
    pictures = [np.asarray(picture, np.uint8) for picture in blurred]
    assert shown_size(pictures) is None

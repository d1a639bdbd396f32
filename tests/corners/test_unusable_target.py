"""What looks like a board and cannot be measured is named, and a board is not taken for it."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.corners.board_search import search_board
from calib.corners.board_size import ShownSize, shown_size
from calib.corners.detect_all import detect
from calib.corners.unusable_target import CIRCLES, shows_circles, why_unusable
from calib.errors import NotEnoughDataError, OtherBoardError
from calib.session.board import Board
from tests.corners.test_board_size import boards, gravel
from tests.importing import recordings

Picture = NDArray[np.uint8]
STEP = 40
"""px between the drawn circles."""


def circles(columns: int, rows: int, *, staggered: bool, light: bool = False) -> list[Picture]:
    """Return three pictures of a grid of circles on a tilted sheet."""
    drawn = []
    for tilt in (0.0, 0.0003, -0.0004):
        sheet = np.full((600, 800), 220, np.uint8)
        for row in range(rows):
            for column in range(columns):
                x = (2 * column + row % 2 if staggered else 2 * column) * STEP + 100
                y = (row if staggered else 2 * row) * STEP + 60
                cv2.circle(sheet, (x, y), STEP // 3 if staggered else STEP // 2, 40, -1, 16)
        homography = np.array([[0.9, 0.05, 20], [0.02, 0.95, 10], [tilt, 0.0002, 1.0]])
        picture = cv2.warpPerspective(sheet, homography, (800, 600), borderValue=220)
        picture = cv2.GaussianBlur(picture, (0, 0), 1.0)
        drawn.append(np.asarray(255 - picture if light else picture, np.uint8))
    return drawn


@pytest.mark.slow
@pytest.mark.parametrize(
    "pictures",
    [
        circles(4, 11, staggered=True),
        circles(4, 11, staggered=True, light=True),
        circles(7, 6, staggered=False),
    ],
    ids=["staggered", "light", "in rows"],
)
def test_circles_are_named(pictures: list[Picture], tmp_path: Path) -> None:
    with pytest.raises(OtherBoardError, match="show a grid of circles, which calib does not"):
        search_board(pictures)
    paths = [tmp_path / f"{number}.png" for number in range(3)]
    for path, picture in zip(paths, pictures, strict=True):
        cv2.imwrite(str(path), picture)
    with pytest.raises(OtherBoardError, match="show a grid of circles"):
        detect(paths, Board(4, 11, 0.02))


def test_a_size_is_announced_only_if_its_corners_are_found() -> None:
    """Chance, or a grid of another kind, makes a size too."""
    pictures = circles(4, 11, staggered=True)
    assert why_unusable(pictures, ShownSize(10, 7, (0, 1, 2), 3)) == CIRCLES
    wall = [np.full((480, 640), 100, np.uint8)] * 3
    seems = why_unusable(wall, ShownSize(10, 7, (0, 1, 2), 3))
    assert seems.startswith("The pictures seem to show a checkerboard of 10x7 inner corners, and")
    assert why_unusable(wall, None) == ""
    good = list(recordings.pictures())
    assert why_unusable(good, shown_size(good)) == ""


@pytest.mark.slow
def test_two_boards_are_named(tmp_path: Path) -> None:
    pictures = [np.hstack([picture, picture]) for picture in recordings.pictures()[:4]]
    says = "two 7x6 boards are seen: show one board alone"
    with pytest.raises(OtherBoardError, match=f"In the pictures {says}"):
        search_board(pictures)
    paths = [tmp_path / f"{number}.png" for number in range(8)]
    single = np.hstack([recordings.pictures()[0], np.full((480, 640), 220, np.uint8)])
    for path, picture in zip(paths, [single, *pictures, *pictures[1:]], strict=True):
        cv2.imwrite(str(path), picture)
    with pytest.raises(NotEnoughDataError, match=f"found in 1 of 8 pictures: {says}"):
        detect(paths, recordings.BOARD)


@pytest.mark.parametrize("blur", [0, 4, 12, 20])
def test_no_board_is_taken_for_circles(blur: float) -> None:
    assert not shows_circles(boards(8, 6, (960, 720), blur)[:4])


@pytest.mark.parametrize("size", [8, 16, 30])
def test_gravel_is_no_grid_of_circles(size: int) -> None:
    random = np.random.default_rng(size)
    assert not shows_circles([gravel(random, size) for _ in range(2)])

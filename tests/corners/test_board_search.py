"""The board that pictures show is found without a declared one, and none where there is none."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.corners.board_search import FoundBoard, _find_charuco, search_board
from calib.corners.markers import read_markers
from calib.session.board import Board
from calib.session.board_section import board_to_yaml
from calib.session.coding import AprilGrid, Charuco, grid_board
from fixtures.coded_boards import KINDS, LEGACY, Kind, poses
from fixtures.coded_pictures import Lens
from tests.corners import test_other_makers
from tests.importing import recordings

LENS = Lens(width=640, height=480, focal=640.0)


def views(kind: Kind) -> list[NDArray[np.uint8]]:
    """Return pictures of the board, some of which show a part of it."""
    size = 2 * max(kind.board.half)
    return [kind.view(pose, lens=LENS).picture for pose in poses(2, 3, 1.2 * size)]


def test_a_checkerboard_is_found_with_its_size() -> None:
    pictures = list(recordings.pictures())
    pictures[1] = np.full_like(pictures[1], 90)
    search = search_board(pictures)
    assert search
    assert (search.kind, search.board.columns, search.board.rows) == ("checkerboard", 7, 6)
    assert (search.pictures, search.searched) == (3, 4)
    assert search.options == "--board 7x6 --square-mm 25"


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_a_board_with_markers_is_found_with_its_layout(name: str) -> None:
    declared = KINDS[name].board
    search = search_board(views(KINDS[name]))
    assert search
    assert (search.board.columns, search.board.rows) == (declared.columns, declared.rows)
    match declared.coding, search.board.coding:
        case Charuco() as printed, Charuco() as coding:
            # a marker of a size is measured to a hundredth of a square or two
            assert coding.marker == pytest.approx(printed.marker / declared.square, abs=0.03)
            assert coding.legacy_pattern == printed.legacy_pattern
            assert coding.dictionary.rpartition("_")[0] == printed.dictionary.rpartition("_")[0]
        case AprilGrid(spacing), AprilGrid(found_spacing):
            assert found_spacing == spacing
            assert not search.is_vague
        case pair:
            raise AssertionError(pair)
    assert search.to_yaml(30.0)[search.side_key] == 30.0
    if name == "legacy":
        assert search.options.startswith("--board 6x7 --type charuco --square-mm 25 --marker-mm 17")
        assert search.options.endswith(" --dictionary DICT_5X5_50 --legacy-pattern")


@pytest.mark.parametrize(
    "name",
    [
        "aprilgrid from 40",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in (
                *("charuco from 100, inverted", "gridboard from 30", "as OpenCV draws tags"),
                *("charuco from 17", "aprilgrid inverted", "gridboard inverted", "one cell"),
            )
        ),
    ],
)
def test_the_first_marker_and_a_negative_print_are_found(name: str) -> None:
    declared = test_other_makers.BOARDS[name]
    search = search_board([picture for picture, _ in test_other_makers.views(declared)[:2]])
    assert search
    printed = search.to_yaml(1000 * declared.square)
    expected = board_to_yaml(declared)
    dictionary = str(expected.pop("dictionary", ""))
    assert str(printed.pop("dictionary", "")).rpartition("_")[0] == dictionary.rpartition("_")[0]
    if marker_mm := expected.pop("marker_mm", None):
        assert printed.pop("marker_mm") == pytest.approx(marker_mm, rel=0.05)
    assert printed == expected
    assert ("--first-marker" in search.options) == ("from" in name)
    assert ("--inverted" in search.options) == ("inverted" in name)


@pytest.mark.slow
def test_a_grid_of_april_tags_has_squares_between_them_or_not() -> None:
    tags = replace(
        test_other_makers.GRID, coding=grid_board(0.25, "DICT_APRILTAG_36h11", first_marker=5)
    )
    search = search_board([picture for picture, _ in test_other_makers.views(tags)[:2]])
    assert search
    assert search.kind == "gridboard"
    assert search.board.coding == tags.coding


@pytest.mark.slow
def test_a_board_that_faces_the_camera_does_not_hide_the_size_of_its_markers() -> None:
    """Markers of nearly any size are linked in a picture in which they lie as in a drawing."""
    facing = np.array([0, 0, 0, 0.0, 0.0, 0.33])
    tilted = [np.array([0.7 * side, 0.5, 0.4, 0.02, 0.0, 0.36]) for side in (-1, 1)]
    pictures = [LEGACY.view(pose, lens=LENS).picture for pose in (facing, *tilted)]
    search = _find_charuco([read_markers(p, "DICT_5X5_50", 1) for p in pictures], "DICT_5X5_50")
    assert search
    assert search.pictures == 3
    assert isinstance(search.board.coding, Charuco)
    assert search.board.coding.marker == pytest.approx(0.7, abs=0.03)


def random_cells(seed: int) -> NDArray[np.uint8]:
    """Return light and dark cells, as a tiled floor has them."""
    cells = (np.random.default_rng(seed).uniform(size=(12, 16)) < 0.5) * 190.0 + 30
    return np.asarray(cv2.resize(cells, (480, 360), interpolation=cv2.INTER_NEAREST), np.uint8)


def gravel(seed: int) -> NDArray[np.uint8]:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 1, (360, 480)), (0, 0), 4)
    return np.asarray(255 * (noise - noise.min()) / np.ptp(noise), np.uint8)


@pytest.mark.parametrize("draw", [gravel, pytest.param(random_cells, marks=pytest.mark.slow)])
def test_no_board_is_found_where_there_is_none(draw: Callable[[int], NDArray[np.uint8]]) -> None:
    assert search_board([draw(seed) for seed in range(4)]) is None


def test_a_side_that_is_not_stated_is_no_number() -> None:
    board = Board(7, 6, 1.0, coding=Charuco(0.7, "DICT_5X5_50"))
    assert (
        FoundBoard(board, 3, 4)
        .options_for(None)
        .startswith("--board 7x6 --type charuco --square-mm MM --marker-mm MM")
    )

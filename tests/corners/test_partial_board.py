"""Checkerboards that are partly hidden: which corners are seen is told by the board's outline, or
not at all.
"""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.corners import detect
from calib.corners.detection import Detection, NotFound
from calib.corners.find import find_board
from calib.corners.partial_board import find_partial_board
from calib.session.board import Board
from calib.session.session import read_session
from fixtures.rays import FIXTURES
from tests.corners.test_detect import BOARD, Scene, moved_along_x

SQUARE = Board(9, 9, 0.02)
SCENE = Scene(size=(960, 720), focal=750.0)


def covered(
    picture: NDArray[np.uint8], truth: NDArray[np.float64], corners: list[int], light: int = 120
) -> NDArray[np.uint8]:
    """The corners in the hull of some are hidden."""
    hull = cv2.convexHull(np.rint(truth[corners]).astype(np.int32))
    return np.asarray(cv2.fillPoly(picture.copy(), [hull], light), np.uint8)


def off(detection: Detection, truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """px, of the corners that were found."""
    return np.asarray(
        np.linalg.norm(detection.corners - truth, axis=1)[np.isfinite(detection.corners[:, 0])]
    )


@pytest.mark.slow
def test_a_board_with_a_covered_middle_corner_is_located() -> None:
    """The sector detector goes astray around some discs; then there is no part."""
    partial_count = 0
    for roll in (0.2, 1.0, -1.2):
        for light in (40, 120, 255):
            picture, truth = Scene(size=(960, 720), focal=750.0, roll=roll).draw()
            hidden = cv2.circle(
                picture, tuple(np.rint(truth[31]).astype(int).tolist()), 40, light, -1
            )
            detection = find_board(np.asarray(hidden, np.uint8), BOARD)
            if isinstance(detection, Detection):
                partial_count += 1
                assert detection.detector == "part"
                errors = off(detection, truth)
                assert len(errors) >= 30
                assert (
                    np.sqrt((errors**2).mean()) < 0.05
                )  # a drawn corner's is 0.02, and one may be touched
    assert partial_count >= 5


@pytest.mark.slow
def test_a_detection_does_not_depend_on_earlier_ones() -> None:
    """OpenCV's detector draws random numbers, which go on from picture to picture; with this
    picture it shows.
    """
    picture, truth = Scene(size=(960, 720), focal=750.0, roll=1.0).draw()
    hidden = np.asarray(
        cv2.circle(picture, tuple(np.rint(truth[31]).astype(int).tolist()), 40, 120, -1), np.uint8
    )

    def found(seed: int) -> NDArray[np.float64]:
        cv2.setRNGSeed(seed)
        rough = detect._by_sectors(hidden, Board(3, 3, 0.02))
        assert rough
        return rough.corners

    assert all(np.array_equal(found(seed), found(0)) for seed in range(1, 12))


def test_a_board_with_one_end_cut_off_is_located() -> None:
    """Both long sides and one short one are seen: the columns run along the long ones."""
    picture, truth = SCENE.draw()
    edge = int(truth[:, 0].min() * 0.25 + truth[:, 0].max() * 0.75)
    detection = find_board(np.ascontiguousarray(picture[:, :edge]), BOARD)
    assert isinstance(detection, Detection)
    assert 30 <= len(off(detection, truth)) < 54
    assert off(detection, truth).max() < 0.2


@pytest.mark.parametrize("quarters", range(4))
def test_blurs_of_a_part_belong_to_the_edges_of_the_board(quarters: int) -> None:
    """Motion along the rows crosses the edges along the columns, however the picture is turned. A
    part that is turned by a quarter is found with its rows for columns.
    """
    picture, truth = replace(SCENE, roll=0.1).draw()
    edge = int(truth[:, 0].min() * 0.25 + truth[:, 0].max() * 0.75)
    shown = moved_along_x(picture)[:, :edge]
    detection = find_board(np.ascontiguousarray(np.rot90(shown, quarters)), BOARD)
    assert isinstance(detection, Detection)
    assert detection.detector == "part"
    visible = np.isfinite(detection.corners[:, 0])
    assert np.array_equal(np.isfinite(detection.blurs).all(1), visible)
    blurs = detection.blurs[visible]
    assert (blurs[:, 1] > 1.4 * blurs[:, 0]).all()


def test_two_sides_locate_a_part_of_a_square_board_only() -> None:
    for board, is_located in ((SQUARE, True), (Board(9, 7, 0.02), False)):
        picture, truth = Scene(
            board=board, size=(960, 720), focal=750.0, tilt=(0.2, 0.1), roll=0.1
        ).draw()
        grid = truth.reshape(board.rows, board.columns, 2)
        far = grid[-1, -1] + (grid[-1, -1] - grid[0, 0])
        distractors = [
            grid[0, 5] * 2 - grid[1, 5],
            far,
            grid[5, 0] * 2 - grid[5, 1],
            grid[5, 5],
        ]  # all but the upper left, in two strips
        hidden = picture.copy()
        above = 2 * grid[0, 5] - grid[2, 5]
        left_of_board = 2 * grid[5, 0] - grid[5, 2]
        right = 2 * grid[0, -1] - grid[2, -1] + 3 * (grid[0, -1] - grid[0, -2])
        downwards = 2 * grid[-1, 0] - grid[-1, 2] + 3 * (grid[-1, 0] - grid[-2, 0])
        end = distractors[1]
        for corners in (
            [above, right, end, grid[-1, 5] + 3 * (grid[-1, 5] - grid[-2, 5])],
            [left_of_board, downwards, end, grid[5, -1]],
        ):
            cv2.fillPoly(hidden, [np.rint(corners).astype(np.int32)], 120)
        detection = find_board(hidden, board)
        if is_located:
            assert isinstance(detection, Detection)
            assert off(detection, truth).max() < 0.2
        else:
            assert isinstance(detection, NotFound)
            assert "and not which: show it whole, or two neighbouring sides" in detection.reason


def test_a_part_without_an_outline_is_refused_with_the_reason() -> None:
    picture, truth = Scene(
        board=SQUARE, size=(960, 720), focal=750.0, tilt=(0.1, 0.1), roll=0.0, distance=12.0
    ).draw()
    (x, y), (right, below) = np.rint(truth[[20, 60]]).astype(int).tolist()
    detection = find_board(
        np.ascontiguousarray(picture[y - 40 : below + 40, x - 40 : right + 40]), SQUARE
    )
    assert isinstance(detection, NotFound)
    assert "and not which" in detection.reason


def test_a_complete_board_of_another_size_is_not_taken_for_a_part() -> None:
    """The board's margin is visible all around, where the declared board would go on."""
    picture, _ = Scene(board=Board(7, 5, 0.025), size=(960, 720), focal=750.0).draw()
    assert isinstance(find_board(picture, BOARD), NotFound)


@pytest.mark.slow
def test_a_larger_board_is_not_taken_for_a_part() -> None:
    board = Board(11, 8, 0.025)
    picture, truth = Scene(board=board, size=(960, 720), focal=750.0, distance=18.0).draw()
    hidden = np.asarray(
        cv2.circle(picture, tuple(np.rint(truth[38]).astype(int).tolist()), 30, 120, -1), np.uint8
    )
    assert isinstance(find_board(hidden, board), Detection)
    assert isinstance(find_board(hidden, BOARD), NotFound)


@pytest.mark.slow
@pytest.mark.slow
def test_whatever_is_covered_no_corner_is_taken_for_another() -> None:
    """Discs and bands of any grey anywhere, bands along the squares among them, white ones too."""
    rng = np.random.default_rng(4)
    partial_count = 0
    for trial in range(30):
        board = (BOARD, SQUARE, Board(8, 6, 0.025))[trial % 3]
        scene = Scene(
            board=board,
            focal=480.0,
            tilt=tuple(rng.uniform(-0.5, 0.5, 2)),
            roll=rng.uniform(-0.6, 0.6),
            seed=trial,
        )
        picture, truth = scene.draw()
        grid = truth.reshape(board.rows, board.columns, 2)
        light = int(rng.choice([20, 120, 235, 255]))
        if trial % 2:
            cv2.circle(
                picture,
                tuple(np.rint(truth[rng.integers(board.count)]).astype(int).tolist()),
                int(rng.uniform(15, 80)),
                light,
                -1,
            )
        else:  # from somewhere between two columns to beyond the board's end, along its squares
            first = rng.integers(1, board.columns - 3)
            start = grid[:, first] + rng.uniform(0.2, 0.8) * (grid[:, first + 1] - grid[:, first])
            downwards = 3 * (start[-1] - start[-2])
            sideways = 2 * (grid[0, -1] - grid[0, 0])
            band = [
                start[0] - downwards,
                start[-1] + downwards,
                start[-1] + downwards + sideways,
                start[0] - downwards + sideways,
            ]
            cv2.fillPoly(picture, [np.rint(band).astype(np.int32)], light)
        detection = find_board(picture, board)
        if isinstance(detection, Detection):
            partial_count += detection.detector == "part"
            assert (
                off(detection, truth).max() < 2
            ), (  # a corner at a cover's edge may be moved; a square is 15 px and more
                f"trial {trial}"
            )
    assert partial_count >= 7


def test_a_picture_that_ends_within_the_board_raises_no_error() -> None:
    """Lines halfway between those of the detected grid may lie outside such a picture."""
    picture = np.asarray(
        cv2.imread(str(FIXTURES / "bump" / "frames" / "0002.jpg"), cv2.IMREAD_GRAYSCALE), np.uint8
    )
    cropped = picture[: len(picture) * 2 // 3]
    assert find_partial_board(cropped, read_session(FIXTURES / "bump").board) is None

"""The same corner first in every view."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.corners.detect import find_corners
from calib.corners.ordering import canonical_order
from calib.session.board import Board
from tests.corners.test_detect import Scene, rms

TOLD_BY_COLOUR = (Board(9, 6, 1.0), Board(6, 9, 1.0), Board(4, 3, 1.0))
SYMMETRIC = (Board(9, 7, 1.0), Board(8, 6, 1.0), Board(7, 7, 1.0), Board(6, 6, 1.0))
QUARTERS = (0, 90, 180, 270)


def readings(corners: NDArray, board: Board) -> list[NDArray]:
    """Every order, mirrored ones too, in which a detector may return a grid of this size."""
    grid = corners.reshape(board.rows, board.columns, 2)
    grids = [grid, grid[::-1], grid[:, ::-1], grid[::-1, ::-1]]
    if board.columns == board.rows:
        grids += [g.swapaxes(0, 1) for g in grids]
    return [g.reshape(-1, 2) for g in grids]


@pytest.mark.parametrize("roll", QUARTERS)
@pytest.mark.parametrize("board", TOLD_BY_COLOUR, ids=str)
def test_colour_names_the_first_corner_at_any_roll(board: Board, roll: int) -> None:
    picture, truth = Scene(board=board, roll=np.deg2rad(roll + 7)).draw()
    for reading in readings(truth, board):
        np.testing.assert_array_equal(canonical_order(picture, reading, board), truth)


@pytest.mark.parametrize("roll", [-80, -30, 0, 30, 80])
@pytest.mark.parametrize("board", SYMMETRIC, ids=str)
def test_a_symmetric_board_keeps_its_order_while_rolled_little(board: Board, roll: int) -> None:
    if board == Board(6, 6, 1.0):
        roll //= 2  # four readings
    picture, truth = Scene(board=board, roll=np.deg2rad(roll), tilt=(0.2, 0.2)).draw()
    for reading in readings(truth, board):
        np.testing.assert_array_equal(canonical_order(picture, reading, board), truth)


@pytest.mark.parametrize("roll", range(0, 360, 45))
@pytest.mark.parametrize("board", [*TOLD_BY_COLOUR, *SYMMETRIC], ids=str)
def test_an_order_is_never_mirrored(board: Board, roll: int) -> None:
    picture, truth = Scene(board=board, roll=np.deg2rad(roll + 3)).draw()
    for reading in readings(truth, board):
        grid = canonical_order(picture, reading, board).reshape(board.rows, board.columns, 2)
        x, y = grid[0, 1] - grid[0, 0], grid[1, 0] - grid[0, 0]
        assert x[0] * y[1] - x[1] * y[0] > 0


def test_colours_are_recognised_under_a_side_lamp_and_a_highlight() -> None:
    board = Board(9, 6, 1.0)
    picture, truth = Scene(board=board).draw()
    lamp = np.linspace(0.1, 1.0, picture.shape[1])
    dim = np.rint(picture * lamp).astype(np.uint8)
    cv2.circle(
        dim, (int(truth[0, 0]), int(truth[0, 1])), 30, 255, -1
    )  # over the squares at corner 0
    for reading in readings(truth, board):
        np.testing.assert_array_equal(canonical_order(dim, reading, board), truth)


def test_sixteen_bits_are_ordered_alike() -> None:
    board = Board(9, 6, 1.0)
    picture, truth = Scene(board=board).draw()
    np.testing.assert_array_equal(
        canonical_order(picture.astype(np.uint16) * 200, truth[::-1], board), truth
    )


@pytest.mark.parametrize("roll", QUARTERS)
def test_detected_corners_come_in_that_order(roll: int) -> None:
    board = Board(9, 6, 1.0)
    picture, truth = Scene(board=board, roll=np.deg2rad(roll + 10)).draw()
    detection = find_corners(picture, board)
    assert detection is not None
    assert rms(detection.corners, truth) < 0.08

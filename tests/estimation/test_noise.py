"""The noise floor, against noise that was put in."""

import numpy as np
import pytest

from calib.estimation.noise import burst_noise, short_scale_noise
from calib.session.board import Board
from calib.session.coding import AprilGrid

BOARD = Board(9, 7, 0.02)
GRID = Board(8, 8, 0.015, coding=AprilGrid(0.3))
SIGMA = 0.1
"""px per axis"""


def smooth(views: int, board: Board = BOARD) -> np.ndarray:
    """(V, N, 2) px: an error over the board, other in every view: far above the noise, but it bends
    by less from corner to corner.
    """
    at = board.points()[:, :2] / 0.08
    rng = np.random.default_rng(2)
    terms = np.stack([np.ones(len(at)), at[:, 0], at[:, 1], at[:, 0] ** 2, at[:, 0] * at[:, 1]], -1)
    return np.asarray(
        np.einsum("nk,vkc->vnc", terms * [1, 1, 1, 0.1, 0.1], rng.normal(0, 1.0, (views, 5, 2)))
    )


def noise(views: int, board: Board = BOARD) -> np.ndarray:
    return np.random.default_rng(3).normal(0, SIGMA, (views, board.count, 2))


@pytest.mark.parametrize("board", [BOARD, GRID], ids=str)
def test_the_short_scale_part_is_the_noise_for_any_smooth_error(board: Board) -> None:
    result = short_scale_noise(smooth(20, board) + noise(20, board), board)
    assert result == pytest.approx(
        2**0.5 * SIGMA, rel=0.06
    )  # three sigma of what 2000 differences tell


def test_differences_within_a_burst_are_the_noise_for_any_model_error() -> None:
    """Half of the corners are off by 1 px, as of a bad print, alike in all pictures of a burst;
    some were not seen in one of them.
    """
    pattern = np.where(np.arange(BOARD.count) % 2, 1.0, -1.0)[None, :, None] + smooth(5)
    residuals = np.repeat(pattern, 4, axis=0) + noise(20)
    residuals[3, :5] = np.nan
    poses = np.repeat(np.arange(5), 4).tolist()
    result = burst_noise(residuals, poses)
    assert result
    assert result == pytest.approx(
        2**0.5 * SIGMA, rel=0.07
    )  # six degrees of freedom of each pose are allowed for, but not in the noise here
    rough = short_scale_noise(residuals, BOARD)
    assert rough
    assert rough > 5 * result


def test_pictures_of_different_poses_give_no_noise() -> None:
    assert burst_noise(noise(20), list(range(20))) is None


def test_copies_of_a_picture_are_no_burst() -> None:
    """Copies have no noise between them, which says nothing about the corners' noise."""
    picture = noise(1)
    assert burst_noise(np.tile(picture, (6, 1, 1)), [0] * 6) is None
    burst = noise(6)
    expected = burst_noise(burst, [0] * 6)
    assert burst_noise(np.concatenate([burst, burst]), [0] * 12) == pytest.approx(expected)

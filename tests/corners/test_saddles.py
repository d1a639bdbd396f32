"""Saddles of grey, as many as there are."""

import numpy as np
import pytest

from calib.corners import saddles
from calib.corners.detect import find_corners
from calib.corners.saddle_grid import find_grid
from calib.corners.saddles import find_saddles
from calib.session.board import Board
from tests.corners.test_detect import BOARD, Scene


def noise(size: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 255, (size, size), np.uint8)


def test_more_than_opencv_looks_at_in_one_call_are_found() -> None:
    """32,767 peaks and more, of which some have edges that cross."""
    assert len(find_saddles(noise(960), 10**6).points) > 20_000


def test_nothing_hangs_on_how_many_are_looked_at_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = find_saddles(noise(120), 1000)
    monkeypatch.setattr(saddles, "AT_ONCE", 7)
    parts = find_saddles(noise(120), 1000)
    for name in ("points", "bends", "edges"):
        assert np.array_equal(getattr(whole, name), getattr(parts, name))


def test_a_board_larger_than_any_picture_is_looked_for_in_bounded_time_and_memory() -> None:
    assert find_corners(noise(960), Board(1000, 1000, 0.001)) is None


def test_a_stray_saddle_at_the_rim_is_not_a_larger_board_and_a_line_of_them_is() -> None:
    picture, _ = Scene().draw()
    grid = find_grid(picture, BOARD)
    assert grid is not None
    assert len(list(grid.whole(BOARD))) == 1
    assert not list(grid.whole(Board(8, 6, 0.025)))  # a line more
    assert not list(grid.whole(Board(9, 5, 0.025)))
    assert not list(grid.whole(Board(10, 6, 0.025)))  # a line fewer
    stray = np.full((7, 9, 2), np.nan)
    stray[:6], stray[6, 3] = grid.points if grid.points.shape[:2] == (6, 9) else grid.points.swapaxes(0, 1), (1.0, 1.0)
    (whole,) = type(grid)(stray).whole(BOARD)
    assert np.array_equal(whole.reshape(6, 9, 2), stray[:6])

"""Saddles of grey, as many as there are."""

import numpy as np
import pytest

from calib.corners import saddles
from calib.corners.detect import find_corners
from calib.corners.detection import Detection, NotFound
from calib.corners.find import find_board
from calib.corners.saddle_grid import find_grid
from calib.corners.saddles import find_saddles
from calib.session.board import Board
from capture.finders import make_finder
from capture.frames import Frame
from capture.gate import judge_frame
from fixtures import corner_pictures
from fixtures.corner_pictures import draw
from tests.corners.test_detect import BOARD, Scene


def noise(size: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 255, (size, size), np.uint8)


def test_more_saddles_than_one_call_of_opencv_handles_are_found() -> None:
    """32,767 peaks and more, of which some have edges that cross."""
    assert len(find_saddles(noise(960), 10**6).points) > 20_000


def test_the_size_of_a_batch_changes_no_saddle(monkeypatch: pytest.MonkeyPatch) -> None:
    one_band = find_saddles(noise(120), 1000)
    monkeypatch.setattr(saddles, "RING_BATCH", 7)
    many_bands = find_saddles(noise(120), 1000)
    for name in ("points", "curvatures", "edges"):
        assert np.array_equal(getattr(one_band, name), getattr(many_bands, name))


@pytest.mark.slow
def test_a_board_larger_than_any_picture_is_looked_for_in_bounded_time_and_memory() -> None:
    assert find_corners(noise(960), Board(1000, 1000, 0.001)) is None


def test_a_stray_saddle_at_the_rim_is_not_a_larger_board_and_a_line_of_them_is() -> None:
    picture, _ = Scene().draw()
    grid = find_grid(picture, BOARD)
    assert grid is not None
    assert len(list(grid.board_positions(BOARD))) == 1
    assert not list(grid.board_positions(Board(8, 6, 0.025)))  # a line more
    assert not list(grid.board_positions(Board(9, 5, 0.025)))
    assert not list(grid.board_positions(Board(10, 6, 0.025)))  # a line fewer
    stray = np.full((7, 9, 2), np.nan)
    stray[:6], stray[6, 3] = (
        (grid.points if grid.points.shape[:2] == (6, 9) else grid.points.swapaxes(0, 1)),
        (1.0, 1.0),
    )
    (positions,) = type(grid)(stray).board_positions(BOARD)
    assert np.array_equal(positions.reshape(6, 9, 2), stray[:6])


def beside(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Both in one picture, the second to the right, on white."""
    wide = np.full((max(len(first), len(second)), first.shape[1] + second.shape[1]), 255, np.uint8)
    wide[: len(first), : first.shape[1]] = first
    wide[: len(second), first.shape[1] :] = second
    return wide


def test_two_boards_in_one_picture_are_reported() -> None:
    """Both finders tell two boards from one, and take neither another kind of board nor half of a
    second one for two.
    """
    picture, _ = Scene().draw()
    double_picture = beside(picture, np.ascontiguousarray(picture[::-1, ::-1]))
    detection = find_board(double_picture, BOARD)
    assert isinstance(detection, NotFound)
    assert detection.reason == "two 9x6 boards are seen: show one board alone"
    frames = [Frame(double_picture, 0, time_s) for time_s in (0.9, 1.0)]
    earlier, current = map(make_finder(BOARD).look, frames)
    assert (
        judge_frame(current, earlier, ()).sentence
        == "Two 9x6 boards are seen: show one board alone."
    )
    second = draw(corner_pictures.Scene(board=Board(7, 5, 1.0)), np.random.default_rng(0)).picture
    for alone in (beside(picture, second), beside(picture, picture[:, : picture.shape[1] // 2])):
        assert isinstance(find_board(alone, BOARD), Detection)
        assert make_finder(BOARD).look(Frame(alone, 0, 1.0)).corners is not None

"""The board that pictures show in place of the declared one, found while they are recorded."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.corners.other_board import SAMPLE_SIZE
from calib.io.images import list_images, read_image
from calib.session.board import Board
from capture.finders import make_finder
from capture.frames import Frame
from capture.gate import FrameDecision
from capture.other_board_search import INTERVAL_S, OtherBoardSearch
from capture.recording_loop import Step
from tests.capture.recordings import FIXTURE, capture

DECLARED = Board(8, 7, 0.02)
"""The board of the fixture has 9x9 corners."""


def step_of(frame: Frame, board: Board) -> Step:
    return Step(frame, make_finder(board).look(frame), FrameDecision(False, ""), None, 0)


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    """Photographs of the board."""
    pictures = [read_image(path) for path in list_images(FIXTURE / "frames")[: SAMPLE_SIZE + 2]]
    return [
        Frame(np.asarray(picture, np.uint8), i, 9.0 * i, isolated=True)
        for i, picture in enumerate(pictures)
    ]


def test_the_size_that_the_pictures_show_is_named(frames: list[Frame]) -> None:
    search = OtherBoardSearch(DECLARED)
    for frame in frames:
        search.add(step_of(frame, DECLARED))
    assert len(search.pictures) == SAMPLE_SIZE
    assert "write board.columns: 9, board.rows: 9 in session.yaml" in search.describe()
    assert not search.pictures, "the next frames are another sample"
    assert search.describe() == ""


def test_a_picture_of_the_declared_board_ends_the_search(frames: list[Frame]) -> None:
    search = OtherBoardSearch(DECLARED)
    search.add(step_of(frames[0], DECLARED))
    search.add(step_of(frames[1], Board(9, 9, 0.02)))
    search.add(step_of(frames[2], DECLARED))
    assert search.is_board_right
    assert not search.pictures


def test_frames_of_a_stream_are_some_time_apart(frames: list[Frame]) -> None:
    search = OtherBoardSearch(DECLARED)
    step = step_of(frames[0], DECLARED)
    for count in range(5):
        streamed = replace(step.frame, isolated=False, time_s=count * INTERVAL_S / 2)
        search.add(replace(step, frame=streamed))
    assert len(search.pictures) == 3


def test_a_recording_without_the_board_names_the_one_that_is_there(tmp_path: Path) -> None:
    board = ("--board", "8x7", "--square-mm", "20")
    done = capture("record", tmp_path / "s", "--source", f"folder:{FIXTURE}", *board)
    assert done.returncode == 3
    assert "or call capture record with --board 9x9" in done.stderr

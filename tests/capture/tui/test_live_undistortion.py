"""The undistorted live picture: compared with the library's own undistorter on a board whose rows a
cover bends, and operated by keys.
"""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from textual.widgets import Input

from calib import Calibration, Undistorter
from calib.io.images import read_grey
from calib.progress import Silent
from calib.session.board import Board
from capture.finders import make_finder
from capture.frames import Frame
from capture.tui.camera import Preview
from capture.tui.cells import CORNER_MARK, LINE_MARK, Mark
from capture.tui.collect import CollectScreen
from capture.tui.farewell import propose_depth
from capture.tui.live_undistortion import (
    GRID_DIVISIONS,
    LiveUndistortion,
    board_lines,
    make_undistortion,
)
from tests.capture.tui.driving import drive, running, see, shown, write
from tests.capture.tui.test_session import FIXTURE

BOARD = Board(9, 9, 0.02)
DEPTH = 0.5


@pytest.fixture(scope="module")
def straight(session: Path) -> LiveUndistortion:
    made = make_undistortion(Silent(), session / "calibration", DEPTH)["straight"]
    assert isinstance(made, LiveUndistortion)
    return made


def pictures(session: Path) -> list[NDArray[np.uint8]]:
    return [
        np.asarray(read_grey(path), np.uint8) for path in sorted((session / "frames").glob("*.jpg"))
    ]


def bend(corners: NDArray[np.float64]) -> float:
    """Return the RMS distance in px of the corners from the straight line through the ends of their
    row or column.
    """
    grid = corners.reshape(9, 9, 2)
    differences = []
    for line in [*grid, *grid.transpose(1, 0, 2)]:
        ahead = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
        differences.append(
            np.abs(np.cross(np.append(ahead, 0), np.pad(line - line[0], ((0, 0), (0, 1))))[:, 2])
        )
    return float(np.sqrt(np.mean(np.square(differences))))


@pytest.mark.slow
def test_points_go_where_the_undistorter_sends_them_and_rows_become_straight(
    session: Path, straight: LiveUndistortion
) -> None:
    undistorter = Undistorter(Calibration.load(session / "calibration"), DEPTH)
    finder, bent, straightened = make_finder(BOARD), [], []
    for picture in pictures(session):
        corners = finder.look(Frame(picture, 0, 0.0)).corners
        assert corners is not None
        moved = straight.points(corners)
        assert (
            np.abs(moved - undistorter.undistort_points(corners)).max() < 0.2
        )  # px: bilinear between nodes 13 px apart
        bent.append(bend(corners))
        straightened.append(bend(moved))
    assert np.mean(straightened) < 0.3
    assert np.mean(bent) > 3 * np.mean(straightened)  # the control


def test_invisible_points_and_points_outside_are_not_drawn(straight: LiveUndistortion) -> None:
    mapped = straight.points(
        np.array([[410.0, 308.0], [np.nan, np.nan], [-40.0, 10.0], [10.0, 700.0]])
    )
    assert np.isfinite(mapped[0]).all()
    assert np.isnan(mapped[1:]).all()


def test_the_picture_is_the_undistorters(session: Path, straight: LiveUndistortion) -> None:
    """Both pictures are reduced alike; the difference is that one is reduced before it is
    undistorted.
    """
    picture = pictures(session)[0]
    undistorted = straight.preview(Preview.of(picture, sharp=True)).image
    wanted = cv2.resize(
        Undistorter(Calibration.load(session / "calibration"), DEPTH).undistort(picture),
        undistorted.shape[::-1],
        interpolation=cv2.INTER_AREA,
    )
    assert undistorted.shape == (616, 820)
    differences = np.abs(undistorted.astype(float) - np.asarray(wanted, float))
    untouched = np.abs(
        Preview.of(picture, sharp=True).image.astype(float) - np.asarray(wanted, float)
    )
    assert np.mean(differences) < 1.5
    assert np.mean(differences) < np.mean(untouched) / 3  # the control


def test_lines_run_along_the_board_or_else_across_the_picture(
    session: Path, straight: LiveUndistortion
) -> None:
    corners = make_finder(BOARD).look(Frame(pictures(session)[0], 0, 0.0)).corners
    assert corners is not None
    marks = straight.marks([Mark(CORNER_MARK, corners)], BOARD)
    lines = [mark for mark in marks if mark.character == LINE_MARK]
    assert len(lines) == 18
    assert np.allclose(lines[0].points, straight.points(corners)[[0, 8]])
    assert len([mark for mark in straight.marks([], BOARD) if mark.character == LINE_MARK]) == 2 * (
        GRID_DIVISIONS - 1
    )
    corners[:9] = np.nan  # a row that is hidden has none
    assert len(board_lines(corners, BOARD)) == 17


@pytest.mark.slow
def test_u_asks_for_a_depth_and_shows_it_straight(session: Path, tmp_path: Path) -> None:
    folder = tmp_path / "session"
    shutil.copytree(session, folder)
    drive(_asked(folder))


async def _asked(session: Path) -> None:
    async with running(session, f"folder:{FIXTURE}") as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s")
        await see(pilot, "u Undistort")
        await see(pilot, "There are no more pictures. Press f to fit anew, ^o for the results.")
        assert (
            "a Auto f Fit o Reopen u Undistort ^o Results m Dots esc Set-up ? Help q Quit"
            in shown(pilot)
        ), "every key in 80 columns"
        screen = pilot.app.screen
        assert isinstance(screen, CollectScreen)
        assert screen._preview is not None
        bent = screen._preview.image.copy()
        await pilot.press("u")
        await see(pilot, "depth in metres")
        field = pilot.app.screen.query_one("#depth", Input)
        assert field.value == f"{propose_depth(session / 'calibration'):g}"
        await write(pilot, "-1")
        await pilot.press("ctrl+s")
        await see(pilot, "is not a depth")
        await write(pilot, "0.5")
        await pilot.press("ctrl+s")
        await see(pilot, "The maps for 0.5 m are being computed.")
        await see(pilot, "Undistorted for 0.5 m.")
        await see(pilot, "u As it is")
        assert np.abs(screen._preview.image.astype(float) - bent).mean() > 1
        await see(pilot, LINE_MARK)
        await pilot.press("u")
        await pilot.pause()
        assert (screen._preview.image == bent).all()
        await pilot.press("ctrl+o")
        await see(pilot, "The error fell from")
        await pilot.press("escape")
        await see(pilot, "^o for the results")

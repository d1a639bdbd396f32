"""From the results to a check of them: with existing pictures, and with pictures that are taken for
it.
"""

import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from textual.pilot import Pilot
from textual.widgets import Input

from calib.progress import Silent
from capture.session_file import read_calibrated
from capture.tui.camera import Task
from capture.tui.check_views import CheckViewsScreen, next_folder
from capture.tui.fitting import open_results
from capture.tui.results import ResultsScreen
from tests.capture.tui.driving import drive, running, see, shown, write
from tests.capture.tui.test_session import FIXTURE


@pytest.fixture
def later(tmp_path: Path) -> Path:
    """A folder of four pictures that the calibration has not used."""
    folder = tmp_path / "later"
    folder.mkdir()
    for picture in sorted((FIXTURE / "frames").glob("*.jpg"))[8:]:
        shutil.copy(picture, folder)
    return folder


@asynccontextmanager
async def results(session: Path) -> AsyncIterator[Pilot[None]]:
    async with running(session) as pilot:
        opened = open_results(Silent(), session / "calibration")
        assert opened["medium"] == "air"
        pilot.app.push_screen(ResultsScreen(session, opened))
        await see(pilot, "The error fell from")
        yield pilot


@pytest.mark.slow
def test_existing_pictures_are_checked_at_once(session: Path, later: Path) -> None:
    drive(_asked(session, later))


async def _asked(session: Path, later: Path) -> None:
    async with results(session) as pilot:
        await pilot.press("c")
        await see(pilot, "Three to five pictures of the board")
        await write(pilot, f"folder:{later / 'nowhere'}")
        await pilot.press("ctrl+s")
        await see(pilot, "(No such file or directory)")
        pilot.app.screen.query_one("#source", Input).value = str(later)
        await pilot.press("ctrl+s")
        await see(pilot, "The calibration is valid. You need not do anything: esc goes back.")
        assert "the error on 4 views is" in shown(pilot)
        await pilot.press("enter")  # not offered
        assert "up to date" not in shown(pilot)
        await pilot.press("escape")
        await see(pilot, "The error fell from")


@pytest.mark.slow
def test_a_change_is_reported_and_an_update_is_written_beside_the_calibration(
    session: Path, later: Path
) -> None:
    for picture in later.glob("*.jpg"):  # as if the sensor had been moved sideways by four pixels
        image = cv2.imread(str(picture))
        assert image is not None
        cv2.imwrite(str(picture), np.roll(image, 4, axis=1))
    drive(_changed(session, later))
    assert (session / "calibration" / "updated" / "calibration.yaml").exists()


async def _changed(session: Path, later: Path) -> None:
    async with results(session) as pilot:
        await pilot.press("c")
        await write(pilot, f"folder:{later}")
        await pilot.press("ctrl+s")
        await see(pilot, "Press enter to")
        assert "The calibration is valid" not in shown(pilot)
        await pilot.press("enter")
        await see(pilot, "Up to date:")
        assert "sigma)" in shown(pilot), "how far each number moved"
        assert "[RESULTS: check]" in shown(pilot)
        await pilot.press("x")
        await see(pilot, "depths in metres")
        await write(pilot, "50")
        await pilot.press("ctrl+s")
        await see(pilot, "far from your boards")
        await write(pilot, "0.5")
        await pilot.press("ctrl+s")
        await see(pilot, "Wrote ")
        updated = session / "calibration" / "updated"
        *exported, undistort = pilot.app.farewell[1:]  # type: ignore[attr-defined]
        assert exported[0] == f"Brought up to date by a check: {updated}"
        assert any(line.startswith(f"Exported {updated / 'export' / 'map_'}") for line in exported)
        assert undistort.startswith(f"Next: calib undistort {updated} ")


@pytest.mark.slow
def test_pictures_for_a_check_go_into_a_session_of_their_own(session: Path, later: Path) -> None:
    drive(_taken(session, later))
    assert len(list((session / "checks" / "001" / "frames").glob("*.png"))) == 4
    assert next_folder(session) == session / "checks" / "002"


async def _taken(session: Path, later: Path) -> None:
    calibration = session / "calibration" / "calibration.yaml"
    async with results(session) as pilot:
        task = Task(
            next_folder(session),
            f"folder:{later}?speed=max",
            read_calibrated(calibration),
            bare=False,
        )
        pilot.app.push_screen(CheckViewsScreen(task, calibration, 0.5))
        await see(pilot, "Press f to check, o to look through it again, esc for the results.")
        await pilot.press("n")  # no cover comes on here
        await pilot.press("f")
        await see(pilot, "The calibration is valid.")
        await pilot.press("escape")
        await see(pilot, "The error fell from")


@pytest.mark.slow
def test_a_check_of_too_few_pictures_is_not_offered(
    session: Path, later: Path, tmp_path: Path
) -> None:
    for picture in sorted(later.glob("*.jpg"))[2:]:
        picture.unlink()
    drive(_few(session, later, tmp_path / "check"))


async def _few(session: Path, later: Path, folder: Path) -> None:
    calibration = session / "calibration" / "calibration.yaml"
    async with results(session) as pilot:
        task = Task(folder, f"folder:{later}?speed=max", read_calibrated(calibration), bare=False)
        pilot.app.push_screen(CheckViewsScreen(task, calibration, 0.5))
        await see(pilot, "Press o to look through it again, esc for the results.")
        await pilot.press("f")
        await see(pilot, "A check takes 3 views at the least")
        await pilot.press("escape")
        await see(pilot, "The error fell from")


@pytest.mark.slow
def test_pictures_that_cannot_update_the_calibration_are_not_offered(
    session: Path, later: Path
) -> None:
    """The screen says so if the pictures are the calibration's own."""
    drive(_useless(session, later))


async def _useless(session: Path, later: Path) -> None:
    async with results(session) as pilot:
        await pilot.press("c")
        await write(pilot, f"folder:{session / 'frames'}")
        await pilot.press("ctrl+s")
        await see(pilot, "Not checked: the calibration was made from these pictures.")
        await pilot.press("escape")
        await see(pilot, "The error fell from")
        for picture in later.glob("*.jpg"):
            image = cv2.imread(str(picture))
            assert image is not None
            cv2.imwrite(str(picture), image[:-2])
        await pilot.press("c")
        await write(pilot, f"folder:{later}")
        await pilot.press("ctrl+s")
        await see(pilot, "With these pictures it cannot be brought up to date")
        await pilot.press("enter")
        await see(pilot, "With these pictures it cannot be brought up to date")

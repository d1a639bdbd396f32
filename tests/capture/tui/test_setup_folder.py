"""The set-up of an existing session: fitted from its folder, and with the texts that were typed the
last time.
"""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from textual.widgets import Input, Select

from calib.cli import main
from calib.io.images import list_images
from capture.tui.app import CaptureApp
from capture.tui.fit import FitScreen
from tests.capture.tui.driving import confirm_cover, drive, running, see, until, write
from tests.capture.tui.test_session import FIXTURE


@pytest.mark.slow
def test_recorded_pictures_can_be_fitted_without_a_camera(tmp_path: Path) -> None:
    session = tmp_path / "session"
    shutil.copytree(FIXTURE, session)
    drive(_recorded(session))
    assert (session / "calibration" / "calibration.yaml").exists()


async def _recorded(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "continued, 12 views without cover")
        await see(pilot, "^r Fit what there is")
        await pilot.press("ctrl+r")
        await see(pilot, "[RESULTS]")


def test_a_fit_of_nothing_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_child(*_: object) -> None:
        raise AssertionError("a process was started for it")

    monkeypatch.setattr(FitScreen, "follow", no_child)
    (tmp_path / "camera").mkdir()
    cv2.imwrite(str(tmp_path / "camera" / "0.png"), np.zeros((616, 820), np.uint8))
    shutil.copy(FIXTURE / "session.yaml", tmp_path)
    drive(_nothing(tmp_path))


async def _nothing(session: Path) -> None:
    async with running(session, f"folder:{session / 'camera'}") as pilot:
        await see(pilot, "continued")
        await confirm_cover(pilot)
        await see(pilot, "No board of 9x9")
        await pilot.press("f")
        await see(pilot, "There is nothing to fit yet:")


@pytest.mark.slow
def test_a_finished_session_is_opened_without_a_fit(tmp_path: Path) -> None:
    session = tmp_path / "session"
    shutil.copytree(FIXTURE, session)
    assert main(["fit", str(session), "--grid", "5x5"]) == 0
    (session / "calibration" / "report.html").unlink()
    fit = (session / "calibration" / "calibration.yaml").stat().st_mtime_ns
    drive(_finished(session))
    assert (session / "calibration" / "calibration.yaml").stat().st_mtime_ns == fit
    assert (session / "calibration" / "report.html").exists()


async def _finished(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "It is fitted: ^o opens its results.")
        await see(pilot, "^o Results")
        await pilot.press("ctrl+o")
        await see(pilot, "[RESULTS]")
        await see(
            pilot,
            "You can trust this calibration where the board was in the picture. The error fell"
            " from 0.4",
        )
        await see(pilot, "if the board's squares are 20 mm.")
        await see(pilot, "e Diagnose c Check s Set-up r Report x Export")
        await pilot.press("r")
        await see(pilot, "The report is ")
        await until(pilot, (session / "calibration" / "report.html").exists)
        assert isinstance(pilot.app, CaptureApp)
        assert pilot.app.farewell[0] == f"The calibration is in {session / 'calibration'}"


def test_ctrl_c_quits_and_keeps_the_typed_texts(tmp_path: Path) -> None:
    drive(_interrupted(tmp_path / "session"))


async def _interrupted(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await pilot.press(*"folder:there", "ctrl+c")
        await until(pilot, lambda: not pilot.app.is_running)
    async with running(session) as pilot:
        await see(pilot, "source folder:there")


def test_a_recorded_session_restores_its_source_and_recorded_part(
    tmp_path: Path, brief: Path
) -> None:
    session = tmp_path / "session"
    shutil.copytree(brief, session, ignore=shutil.ignore_patterns("bare"))
    drive(_again(session, f"folder:{brief}"))


async def _again(session: Path, source: str) -> None:
    async with running(session) as pilot:
        await see(pilot, "continued")
        await see(pilot, "record now without the cover")
        await write(pilot, source)
        pilot.app.screen.query_one("#phase", Select).value = "covered"
        await see(pilot, "record now through the cover")
        await pilot.press("escape")
    async with running(session) as pilot:
        await see(pilot, "continued")
        await see(pilot, "record now through the cover")
        assert pilot.app.screen.query_one("#source", Input).value == source
    async with running(session, "folder:other") as pilot:
        await see(pilot, "source folder:other")
        await see(pilot, "record now through the cover")


def test_views_without_the_cover_can_be_recorded_again(tmp_path: Path, brief: Path) -> None:
    session = tmp_path / "session"
    shutil.copytree(brief, session)
    drive(_anew(session, f"folder:{brief}"))


async def _anew(session: Path, source: str) -> None:
    pictures_before = {
        picture.name: picture.read_bytes() for picture in list_images(session / "bare")
    }
    async with running(session, source) as pilot:
        await see(pilot, f"continued, {len(pictures_before)} views without cover")
        pilot.app.screen.query_one("#phase", Select).value = "anew"
        await see(
            pilot, f"record now without the cover, anew ({len(pictures_before)} go to bare-aside/)"
        )
        await pilot.press("ctrl+s")
        await see(pilot, "[WITHOUT COVER]")
        await see(pilot, "There are no more pictures")
        assert {
            picture.name: picture.read_bytes() for picture in list_images(session / "bare-aside")
        } == pictures_before
        taken = len(list_images(session / "bare"))
        assert taken
        await pilot.press("escape")
        await see(pilot, f"continued, {taken} views without cover")
        assert (
            pilot.app.screen.query_one("#phase", Select).value != "anew"
        )  # the next start adds to them

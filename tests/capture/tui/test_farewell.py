"""What the terminal says when the screen has gone: paths that are there, and commands that can be typed."""

import shutil
from pathlib import Path

from calib.cli import main
from capture.tui.farewell import farewell
from tests.capture.tui.test_session import FIXTURE


def test_of_nothing_it_says_how_to_go_on(tmp_path: Path) -> None:
    assert list(farewell(tmp_path / "my s", None, [])) == [
        f"Nothing is recorded in {tmp_path / 'my s'} yet; what was typed is kept.",
        f"To go on: capture '{tmp_path / 'my s'}'",
    ]


def test_of_pictures_it_counts_them(tmp_path: Path) -> None:
    session = shutil.copytree(FIXTURE, tmp_path / "s")
    assert list(farewell(session, None, [])) == [
        f"{session} has 12 pictures without the cover and 12 through it; it has no calibration yet.",
        f"To go on: capture {session}",
    ]


def test_what_it_says_to_type_goes_from_a_calibration_to_straight_pictures(tmp_path: Path) -> None:
    session = shutil.copytree(FIXTURE, tmp_path / "s")
    assert main(["fit", str(session), "--grid", "5x5"]) == 0
    where, export = farewell(session, None, [])
    assert where == f"The calibration is in {session / 'calibration'}"
    assert main(export.split()[2:]) == 0
    maps = sorted((session / "export").iterdir())
    *told, undistort = farewell(session, session / "calibration" / "calibration.yaml", maps)
    assert told == [where, *(f"Exported {path}" for path in maps)]
    assert main(undistort.split()[2:]) == 0
    assert (session / "undistorted" / "0000.jpg").exists()

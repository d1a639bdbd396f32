"""The terminal's last lines after the screen has gone: existing paths, and commands that can be
typed.
"""

import shutil
from pathlib import Path

import pytest

from calib import Calibration
from calib.cli import main
from calib.verdict.uncertainty import reached_depths
from calib.verdict.verdict import MAPS_HOLD
from capture.tui.farewell import DEPTH, farewell_lines, propose_depth
from tests.capture.tui.test_session import FIXTURE


def test_the_farewell_without_pictures_names_the_next_command(tmp_path: Path) -> None:
    assert list(farewell_lines(tmp_path / "my s", None, [])) == [
        f"Nothing is recorded in {tmp_path / 'my s'} yet; what was typed is kept.",
        f"To go on: capture '{tmp_path / 'my s'}'",
    ]


def test_the_farewell_counts_pictures(tmp_path: Path) -> None:
    session = shutil.copytree(FIXTURE, tmp_path / "s")
    assert list(farewell_lines(session, None, [])) == [
        (
            f"{session} has 12 pictures without the cover and 12 through it; it has no calibration"
            " yet."
        ),
        f"To go on: capture {session}",
    ]


@pytest.mark.slow
@pytest.mark.usefixtures("without_figures")
def test_the_named_commands_lead_from_a_calibration_to_straight_pictures(tmp_path: Path) -> None:
    session = shutil.copytree(FIXTURE, tmp_path / "s")
    assert main(["fit", str(session), "--grid", "5x5"]) == 0
    lines = list(farewell_lines(session, None, []))
    *places, undistort = lines
    assert places == [
        f"The calibration is in {session / 'calibration'}",
        f"The report is {session / 'calibration' / 'report.html'}",
    ]
    assert undistort.split()[:3] == ["Next:", "calib", "undistort"]
    assert main(undistort.split()[2:]) == 0
    assert (session / "undistorted" / "0000.jpg").exists()
    export = ["--format", "npz", "--depth", "0.7", "-o", str(session / "export")]
    assert main(["export", str(session / "calibration"), *export]) == 0
    maps = sorted((session / "export").iterdir())
    *others, undistort = farewell_lines(session, session / "calibration" / "calibration.yaml", maps)
    assert others == [*places, *(f"Exported {path}" for path in maps)]
    assert "--depth 0.7 " in undistort
    assert list(farewell_lines(session, None, [])) == [
        *others,
        undistort,
    ], "of a session that is opened another day"
    (
        session / "calibration" / "calibration.yaml"
    ).touch()  # a later fit, of which nothing is exported
    assert list(farewell_lines(session, None, [])) == lines


def test_the_farewell_names_the_report_where_there_is_one(tmp_path: Path) -> None:
    report = tmp_path / "s" / "calibration" / "report.html"
    shown = report.with_name("calibration.yaml")
    first, *following = farewell_lines(tmp_path / "s", shown, [])
    report.parent.mkdir(parents=True)
    report.write_text("<html>")
    assert list(farewell_lines(tmp_path / "s", shown, [])) == [
        first,
        f"The report is {report}",
        *following,
    ]


def test_the_farewell_of_a_doubtful_calibration_names_the_report(tmp_path: Path) -> None:
    shown = tmp_path / "s" / "calibration" / "calibration.yaml"
    *_, why, following, then = farewell_lines(
        tmp_path / "s", shown, [tmp_path / "map_1m.npz"], doubt="Take care before you trust it."
    )
    assert why == "Take care before you trust it. The report says why, and what to do."
    assert following == f"Next: calib report {shown.parent}"
    assert then.startswith(
        f"Then: calib undistort {shown.parent} {tmp_path / 's' / 'frames'} --depth 1"
    )


def test_maps_that_hold_are_used_next_as_after_a_fit(tmp_path: Path) -> None:
    shown = tmp_path / "s" / "calibration" / "calibration.yaml"
    *_, why, following = farewell_lines(tmp_path, shown, [], depth=0.5, doubt=MAPS_HOLD)
    assert why == f"{MAPS_HOLD} The report says with which."
    assert following.startswith("Next: calib undistort ")


@pytest.mark.parametrize("has_border", [True, False])
def test_the_farewell_crops_a_black_border(tmp_path: Path, has_border: bool) -> None:
    shown = tmp_path / "s" / "calibration" / "calibration.yaml"
    *_, following = farewell_lines(tmp_path, shown, [], depth=0.5, has_black_border=has_border)
    assert following.startswith("Next: calib undistort ")
    assert (" --depth 0.5 --crop 0 -o " in following) == has_border


def test_the_farewell_proposes_a_depth_that_the_boards_support(tmp_path: Path) -> None:
    shown = tmp_path / "s" / "calibration" / "calibration.yaml"
    for written, proposed in ((("60", "0.7"), "0.7"), (("60", "0.05"), "0.5"), ((), "0.5")):
        maps = [tmp_path / f"map_{depth}m.npz" for depth in written]
        *_, following = farewell_lines(tmp_path, shown, maps, depth=0.5, boards=(0.3, 1.2))
        assert f" --depth {proposed} " in following


def test_the_proposed_depth_is_that_of_the_fits_next_command(session: Path, tmp_path: Path) -> None:
    folder = session / "calibration"
    _, median, _ = reached_depths(Calibration.load(folder))
    assert propose_depth(folder) == median
    *_, following = farewell_lines(session, None, [])
    assert f" --depth {propose_depth(folder):g} " in following
    assert propose_depth(tmp_path) == DEPTH, "without a calibration"


def test_the_farewell_proposes_no_use_of_what_must_not_be_used(tmp_path: Path) -> None:
    shown = tmp_path / "calibration" / "calibration.yaml"
    *_, why, following = farewell_lines(tmp_path, shown, [], doubt="Do not use it.")
    assert why == "Do not use it. The report says why, and what to do."
    assert following == f"Next: calib report {shown.parent}"


def test_the_farewell_of_an_interrupted_refit_names_the_older_calibration(tmp_path: Path) -> None:
    shown = tmp_path / "calibration" / "calibration.yaml"
    first, *remainder = farewell_lines(tmp_path, shown, [], was_cancelled=True)
    assert first == (
        "The last fit was ended before it had a result: the calibration is still the previous one."
    )
    assert remainder == list(farewell_lines(tmp_path, shown, []))
    assert not any(
        "previous one" in line
        for line in farewell_lines(tmp_path / "without one", None, [], was_cancelled=True)
    )

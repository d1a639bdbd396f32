"""`calib check`: exit codes, JSON, sentences, and what is written."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from calib.calibration import Calibration
from calib.checking.pictures import Pictures
from calib.checking.result import Change, CheckResult, CheckStatistics, CheckStatus
from calib.checking.update import is_updatable
from calib.cli import main
from calib.commands.check_lines import next_command, result_lines, with_own_verdict
from calib.corners.view import View
from calib.session.session import session_to_yaml
from fixtures.calibrated import with_outcome
from fixtures.later import Later
from fixtures.synthetic import HEIGHT, WIDTH
from tests.checking.conftest import Made

KEYS = {
    *(
        "answer",
        "statistic",
        "degrees_of_freedom",
        "p_value",
        "false_alarm_rate",
        "error_px",
        "expected_px",
        "allowed_px",
        "added_px",
    ),
    *(
        "noise_px",
        "views",
        "views_known",
        "frames_rejected",
        "changes",
        "lacking",
        "note",
        "next",
        "written",
    ),
}


@pytest.fixture(scope="module")
def saved(cameras: Made, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The window's calibration."""
    folder = tmp_path_factory.mktemp("calibration")
    cameras["flat"][1].calibration.save(folder)
    return folder


def session(folder: Path, calibration: Calibration, views: tuple[View, ...]) -> Path:
    """A session of these corners."""
    folder.mkdir()
    document = {
        "format": 1,
        **session_to_yaml(calibration.board, calibration.camera, calibration.cover),
        "corners": "corners.vnl",
    }
    (folder / "session.yaml").write_text(yaml.safe_dump(document))
    lines = [f"{view.name} {x!r} {y!r} 0" for view in views for x, y in view.corners.tolist()]
    (folder / "corners.vnl").write_text("\n".join(["# filename x y level", *lines, ""]))
    return folder


def test_a_valid_calibration_exits_with_0(
    cameras: Made, saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made, checker = cameras["flat"]
    later = session(
        tmp_path / "later", checker.calibration, Later.drawn(made, None, 301, 3).views()
    )
    assert main(["check", str(saved), str(later)]) == 0
    output = capsys.readouterr().out
    assert output.startswith("The calibration is valid.\n- the error on 3 views is 0.1")
    assert "px are expected" in output
    assert f"Next: calib report {saved}" in output
    fitted = session(tmp_path / "fitted", checker.calibration, checker.calibration.views)
    assert main(["check", str(saved), str(fitted)]) == 0
    output = capsys.readouterr().out
    assert output.startswith("Not checked: the calibration was made from these pictures.")
    assert main(["check", str(saved), str(fitted), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["answer"] == "valid"
    assert document["note"] == "not checked: the calibration was made from these pictures"


def test_a_valid_check_repeats_that_the_calibration_asks_for_care(cameras: Made) -> None:
    calibration = cameras["flat"][1].calibration
    statistics = CheckStatistics(1.0, 1.0, 100, 0.1, 0.1, 0.14, 0.0, 0.05, 1.0, 8)
    valid = CheckResult(CheckStatus.VALID, statistics, (), ())
    trusted = replace(calibration.outcome, mixed_settings=())
    assert with_own_verdict(valid, replace(calibration, outcome=trusted)).note == ""
    mixed = with_outcome(calibration, mixed_settings=("the pictures are of two zooms",))
    note = with_own_verdict(valid, mixed).note
    assert '"take care before you trust it": calib report says why' in note
    fitted = replace(valid, statistics=replace(statistics, reused_views=8))
    assert with_own_verdict(fitted, mixed) == fitted
    broken = replace(valid, status=CheckStatus.BROKEN)
    assert with_own_verdict(broken, mixed) == broken


@pytest.mark.slow
def test_an_invalid_calibration_exits_with_5_and_names_the_change(
    cameras: Made, saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made, checker = cameras["flat"]
    change = next(change for change in checker.changes if change.name == "board_shape")
    later = session(
        tmp_path / "later", checker.calibration, Later.drawn(made, change, 302, 3).views(10)
    )
    assert main(["check", str(saved), str(later), "--json"]) == 5
    answer = json.loads(capsys.readouterr().out)
    assert set(answer) == KEYS
    assert answer["answer"] == "degraded"
    assert answer["p_value"] < answer["false_alarm_rate"] == 0.01
    first = answer["changes"][0]
    assert first["name"] == "board_shape"
    assert first["unit"] == "mm"
    assert first["probability"] > 0.95
    result = checker.check(Pictures(Later.drawn(made, change, 302, 3).views(10), made.board))
    assert not is_updatable(result), "as the terminal UI asks"
    assert is_updatable(checker.check(Pictures(made.views, made.board)))
    assert main(["check", str(saved), str(later), "--update", "-o", str(tmp_path / "out")]) == 3
    assert "cannot be updated" in capsys.readouterr().err
    assert not (tmp_path / "out" / "calibration.yaml").exists()


def test_an_update_keeps_the_history_and_is_more_certain(
    cameras: Made, saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made, checker = cameras["flat"]
    later = session(
        tmp_path / "later", checker.calibration, Later.drawn(made, None, 303, 4).views()
    )
    assert (
        main(["check", str(saved), str(later), "--update", "-o", str(tmp_path / "out"), "--json"])
        == 0
    )
    answer = json.loads(capsys.readouterr().out)
    assert answer["written"] == [str(tmp_path / "out" / "calibration.yaml")]
    assert set(answer) == KEYS | {"moved"}
    for name, item in answer["moved"].items():
        assert item["sigma_after"] < 1.02 * item["sigma_before"], name
        assert abs(item["moved_sigmas"]) < 5, name
    updated = Calibration.load(tmp_path / "out")
    assert len(updated.views) == len(checker.calibration.views) + 4
    assert updated.covariance.shape == checker.calibration.covariance.shape
    (history,) = updated.history.updates
    assert history.calibration_sha256 == checker.calibration.digest
    assert main(["check", str(tmp_path / "out"), str(later)]) == 0


def test_a_named_change_of_the_camera_is_carried_by_an_update(
    cameras: Made, saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made, checker = cameras["flat"]
    change = next(change for change in checker.changes if change.name == "focal")
    drawn = Later.drawn(made, change, 304, 4)
    later = session(tmp_path / "later", checker.calibration, drawn.views(10))
    assert (
        main(["check", str(saved), str(later), "--update", "-o", str(tmp_path / "out"), "--json"])
        == 5
    )
    assert json.loads(capsys.readouterr().out)["changes"][0]["name"] == "focal"
    updated = Calibration.load(tmp_path / "out")
    value, sigma = updated.effects[0].parameters["focal.change"]
    assert abs(float(value) - 10 * float(drawn.direction["focal.change"])) < 5 * float(sigma)
    assert main(["check", str(tmp_path / "out"), str(later)]) == 0


def test_pictures_of_another_size_come_from_another_mode(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((600, 800), 128, np.uint8))
    assert main(["check", str(saved), str(tmp_path), "--json"]) == 5
    answer = json.loads(capsys.readouterr().out)
    assert answer["answer"] == "broken"
    assert answer["changes"][0]["name"] == "other_mode"
    assert (
        answer["changes"][0]["sentence"]
        == "the pictures come from another mode: 800x600 px where the calibration has 3280x2464"
    )
    assert answer["p_value"] is None


@pytest.mark.parametrize("damage", ["truncated", "blank", "none", "missing"])
def test_input_that_cannot_be_checked_is_refused(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], damage: str
) -> None:
    picture = tmp_path / "pictures" / "a.png"
    picture.parent.mkdir()
    if damage in ("truncated", "blank"):
        cv2.imwrite(str(picture), np.full((HEIGHT, WIDTH), 128, np.uint8))
    if damage == "truncated":
        picture.write_bytes(picture.read_bytes()[:-200])
    source = picture if damage == "missing" else picture.parent
    assert main(["check", str(saved), str(source)]) == (3 if damage == "blank" else 2)
    stderr = capsys.readouterr().err
    expected = {
        "truncated": "a.png is truncated or damaged: copy it again, or remove it.",
        "blank": "No picture can be checked: the 9x9 board was found in 0 of 1 picture:",
        "none": "has no pictures: give a session",
        "missing": "a.png",
    }
    assert expected[damage] in stderr
    assert "Traceback" not in stderr


def test_an_output_without_an_update_is_refused(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(saved), str(tmp_path), "-o", str(tmp_path / "out")]) == 2
    assert "write --update with it" in capsys.readouterr().err


def test_pictures_that_do_not_exist_are_refused(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A slip in a name is no damaged picture, which would be left out."""
    assert main(["check", str(saved), str(tmp_path / "a.png"), str(tmp_path / "b.png")]) == 2
    assert "a.png does not exist" in capsys.readouterr().err


def test_another_mode_in_the_folder_one_is_in(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next session's name for "." is that of the folder, also for its frames. A loose picture
    has no session that could be recorded again.
    """
    (tmp_path / "frames").mkdir()
    cv2.imwrite(str(tmp_path / "frames" / "a.png"), np.full((48, 64), 99, np.uint8))
    (tmp_path / "session.yaml").write_text(
        "format: 1\nboard: {columns: 9, rows: 9, square_mm: 20}\ncamera: {width: 64, height: 48}\n"
        "cover: {shape: none}\n"
    )
    monkeypatch.chdir(tmp_path)
    size = "--source 'SOURCE?size=3280x2464'"
    assert main(["check", str(saved), "."]) == 5
    assert f"Next: capture {tmp_path}-again {size}" in capsys.readouterr().out
    assert main(["check", str(saved), "frames/a.png"]) == 5
    assert f"Next: capture {tmp_path}-again {size}" in capsys.readouterr().out
    (tmp_path / "session.yaml").unlink()
    assert main(["check", str(saved), "frames/a.png"]) == 5
    assert f"Next: capture frames-again {size}" in capsys.readouterr().out, "no fit of one picture"


def test_a_valid_check_prints_no_alarm() -> None:
    """A change that is certain, and too small to matter."""
    statistics = CheckStatistics(1e-9, 1.0, 100, 0.12, 0.25, 0.48, 0.004, 0.05, 1.0, 8)
    valid = "\n".join(result_lines(CheckResult(CheckStatus.VALID, statistics, (), ())))
    alarm = "\n".join(result_lines(CheckResult(CheckStatus.DEGRADED, statistics, (), ())))
    assert "too little to matter: it adds 0.004 px or less" in valid
    assert "is an alarm" not in valid
    assert "is an alarm" in alarm


def test_a_valid_check_says_why_a_large_error_is_allowed() -> None:
    """The test looks at a typical view: the square root of 1.44 is 1.2 times what is expected."""
    statistics = CheckStatistics(1.0, 1.44, 100, 0.18, 0.1, 0.14, 0.0, 0.05, 1.0, 8)
    valid = "\n".join(result_lines(CheckResult(CheckStatus.VALID, statistics, (), ())))
    assert "is 0.180 px, but 0.120 px in a typical one; 0.100 px are expected" in valid
    for error, statistic in ((0.13, 1.44), (0.18, 4.0)):
        alike = replace(statistics, error_px=error, statistic=statistic)
        lines = "\n".join(result_lines(CheckResult(CheckStatus.VALID, alike, (), ())))
        assert "typical" not in lines
    larger = replace(statistics, error_px=0.12, statistic=4.0)
    alarm = "\n".join(result_lines(CheckResult(CheckStatus.DEGRADED, larger, (), ())))
    assert "is 0.120 px, but 0.200 px in a typical one; 0.100 px are expected" in alarm


@pytest.mark.parametrize(("name", "is_named"), [("unknown", False), ("board_scale", True)])
def test_what_has_no_name_is_recorded_anew(name: str, is_named: bool, tmp_path: Path) -> None:
    """Its noise holds the change, so sharper pictures would not help."""
    statistics = CheckStatistics(1e-9, 1.0, 100, 1.2, 0.25, 0.48, 1.1, 0.5, 9.7, 8)
    changes = (Change(name, "words", 1.0),)
    result = CheckResult(CheckStatus.BROKEN, statistics, changes, ())
    assert ("sharper pictures" in "\n".join(result_lines(result))) == is_named
    folder = tmp_path / "new"
    folder.mkdir()
    pictures = [folder / f"{number}.png" for number in range(4)]
    for picture in pictures:
        picture.touch()
    command = next_command(result, tmp_path / "out", [folder], updated=False, size=(9, 9))
    expected = f"calib report {tmp_path}/out" if is_named else f"calib fit {folder}"
    assert command == expected
    proposal = next_command(result, tmp_path / "out", pictures[:3], updated=False, size=(9, 9))
    assert proposal == (expected if is_named else f"capture {tmp_path}/new-again"), (
        "no fit of so few"
    )


def test_squares_of_another_size_are_named_and_no_change_of_the_camera(
    cameras: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made, checker = cameras["cone"]
    board = checker.calibration.board
    views = Later.drawn(made, None, 301, 6).views()
    saved = tmp_path / "out"
    checker.calibration.save(saved)
    declared = replace(checker.calibration, board=replace(board, square=3 * board.square))
    later = session(tmp_path / "later", declared, views)
    assert main(["check", str(saved), str(later), "--json"]) == 5
    answer = json.loads(capsys.readouterr().out)
    (change,) = answer["changes"]
    assert change["name"] == "other_board"
    side = 1e3 * board.square
    assert change["sentence"] == (
        f"the squares are {3 * side:g} mm in these pictures, and {side:g} mm in the calibration:"
        f" the pictures agree with the calibration if they are {side:g} mm, so correct the"
        " description of these pictures"
    )
    assert answer["next"] == f"calib check {saved} {later}"


@pytest.mark.slow
def test_pictures_that_agree_with_neither_size_name_no_change_of_the_camera(cameras: Made) -> None:
    made, checker = cameras["flat"]
    board = checker.calibration.board
    change = next(change for change in checker.changes if change.name == "board_shape")
    views = Later.drawn(made, change, 301, 6).views(30.0)
    result = checker.check(Pictures(views, replace(board, square=3 * board.square)))
    assert [change.name for change in result.changes] == ["other_board"]
    assert "the pictures agree with the calibration with neither" in result.changes[0].words


def test_another_board_is_a_note_where_the_pictures_agree(cameras: Made) -> None:
    made, checker = cameras["flat"]
    board = checker.calibration.board
    views = Later.drawn(made, None, 301, 4).views()
    assert checker.check(Pictures(views, replace(board, square=1.0001 * board.square))).note == ""
    result = checker.check(Pictures(views, replace(board, square=1.002 * board.square)))
    assert result.status is CheckStatus.VALID
    assert "if it is the same board, correct the one that is wrong" in result.note
    assert f"- {result.note}." in list(result_lines(result))


def test_another_grid_is_named(cameras: Made) -> None:
    """The corners of some rows alone, with squares that are too large."""
    made, checker = cameras["cone"]
    board = checker.calibration.board
    shorter = replace(board, rows=board.rows - 1, square=3 * board.square)
    count = shorter.count
    views = tuple(
        replace(view, corners=view.corners[:count], weight=view.weight[:count], covariance=None)
        for view in Later.drawn(made, None, 301, 6).views()
    )
    (change,) = checker.check(Pictures(views, shorter)).changes
    assert change.name == "other_board"
    assert "a wrong size looks like a change of the camera" in change.words

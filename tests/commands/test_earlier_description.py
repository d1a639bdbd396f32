"""An earlier description: the options that stay, and the file that a failed fit leaves."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from calib.cli import main
from calib.corners.view import View
from calib.errors import InputError
from calib.importing.session_draft import SessionDraft, write_session
from calib.io.folder_lock import lock_folder
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.point_target import PointTarget
from calib.session.schema import Number
from calib.session.shutter import Shutter
from capture.screen.points_session import PointsSession
from capture.session_file import write_setup
from tests.commands.test_described_session import BOARD, described
from tests.importing import recordings
from tests.session.malformed import WITH_CORNERS, write_good_session
from tests.session.test_points_file import write


def test_a_description_is_corrected_until_a_person_changed_it(photos: Path) -> None:
    described(str(photos), "--board", "8x5", "--square-mm", "20")
    assert described(str(photos), *BOARD).board == Board(7, 6, 0.025)
    file = photos / "session.yaml"
    file.write_text(file.read_text() + "# mine\n")
    with pytest.raises(
        InputError, match=r"is yours .*: set board there, or leave out --board and --square-mm\."
    ):
        described(str(photos), *BOARD)
    assert described(str(photos)).board == Board(7, 6, 0.025)
    assert file.read_text().endswith("# mine\n")


def test_the_session_of_a_person_is_edited_and_not_made_anew(tmp_path: Path) -> None:
    """One of corners has no pictures that could go into another session."""
    write_good_session(tmp_path)
    file = tmp_path / "session.yaml"
    file.write_text(WITH_CORNERS)
    shutil.rmtree(tmp_path / "frames")
    with pytest.raises(
        InputError, match=r"session\.yaml is yours .*: set cover there, or leave out --"
    ):
        described(str(tmp_path), "--cover", "unknown")
    with pytest.raises(InputError, match=r"inner_radius_mm is -3: write a number from"):
        described(str(tmp_path), "--cover", "dome", "--radius", "-3")
    assert file.read_text() == WITH_CORNERS


def test_options_that_are_left_out_stay_as_an_earlier_command_wrote_them(
    photos: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lens = ["--intrinsics", "520,525,322+-3,238"]
    wet = ["--cover", "dome", "--radius", "40+-30", "--index", "1.49", "--outside-index", "1.333"]
    first = described(str(photos), *BOARD, *lens, *wet)
    assert "--outside-index 1.333 is taken as 1.333 ± 0.004" in capsys.readouterr().err
    assert first.cover.medium == Number(1.333, 0.004)
    thick = described(str(photos), "--thickness", "3")
    remark = capsys.readouterr().err
    assert "session.yaml still holds what an earlier command said: the board 7x6, " in remark
    assert "outside_index 1.333 ± 0.004" in remark
    assert ", the lens. An option changes it" in remark
    assert "shape dome" in remark
    assert "thickness" not in remark
    assert thick.board == first.board
    assert thick.camera == first.camera
    assert thick.cover.parameters["thickness"].value == 0.003
    assert thick.cover.parameters["inner_radius"] == first.cover.parameters["inner_radius"]
    assert thick.cover.medium == first.cover.medium
    flat = described(str(photos), "--square-mm", "20", "--cover", "flat", "--distance", "20")
    assert "outside_index 1.333 ± 0.004" in capsys.readouterr().err
    assert flat.board == Board(7, 6, 0.02)
    assert flat.cover.shape == "flat"
    assert flat.cover.medium == first.cover.medium
    assert flat.cover.parameters["thickness"].value == 0.003
    assert described(str(photos), "--cover", "none").cover.shape == "none"


def test_options_change_what_capture_wrote(photos: Path, tmp_path: Path) -> None:
    """Keys that no option mentions stay, such as the shutter."""
    session = tmp_path / "recorded"
    shutil.copytree(photos, session / "frames")
    write_setup(
        session, Board(7, 6, 0.025), recordings.SIZE, None, Shutter(rolling=True, readout=0.02)
    )
    domed = described(str(session), "--cover", "dome", "--radius", "40+-30")
    assert domed.cover.parameters["inner_radius"] == Number(0.04, 0.03)
    assert domed.board == Board(7, 6, 0.025)
    assert domed.camera.shutter == Shutter(rolling=True, readout=0.02)
    assert domed.camera.intrinsics
    assert domed.camera.intrinsics.fx.unknown
    file = session / "session.yaml"
    file.write_text(file.read_text().replace("columns: 7", "columns: 8"))
    with pytest.raises(InputError, match="is yours"):
        described(str(session), "--cover", "none")


def test_options_change_the_cover_of_imported_corners(tmp_path: Path) -> None:
    """The corners stay the source of the fit."""
    folder = tmp_path / "imported"
    board = Board(4, 3, 0.02)
    view = View("a", 100 + 5000 * board.points()[:, :2], np.ones(board.count))
    write_session(SessionDraft(tmp_path / "c.vnl", board, Camera(640, 480), (view,)), folder)
    windowed = described(str(folder), "--cover", "flat", "--distance", "20")
    assert windowed.cover.shape == "flat"
    assert windowed.corners == folder / "corners.vnl"


def test_options_change_the_cover_of_points(tmp_path: Path) -> None:
    """Their target stays, and has no board to be described."""
    write(tmp_path)
    (tmp_path / "session.yaml").unlink()
    PointsSession(tmp_path).describe((640, 480), Number(0.3e-3, 1e-6), None)
    domed = described(str(tmp_path), "--cover", "dome", "--radius", "40")
    assert isinstance(domed.board, PointTarget)
    assert domed.cover.shape == "dome"
    with pytest.raises(InputError, match=r"has a target of points, .* leave out --board"):
        described(str(tmp_path), *BOARD)


def test_a_failed_fit_names_the_description_that_remains(
    photos: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["fit", str(photos), "--board", "5x4", "--square-mm", "25"]
    assert main(words) == 3
    remark = f"{photos}/session.yaml has what your options say."
    assert remark in " ".join(capsys.readouterr().err.split())
    assert main(["fit", str(photos)]) == 3
    assert remark not in " ".join(capsys.readouterr().err.split()), "no option was given"


def test_the_lens_model_is_an_option(photos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An earlier one stays, as the other options do."""
    assert described(str(photos), *BOARD, "--lens", "fisheye").camera.lens == "fisheye"
    capsys.readouterr()
    assert described(str(photos), "--square-mm", "30").camera.lens == "fisheye"
    assert "the lens model fisheye" in capsys.readouterr().err
    assert described(str(photos), "--lens", "opencv").camera.lens == "opencv"


@pytest.mark.slow
def test_a_failed_fit_keeps_the_description_of_a_fit_that_worked(
    photos: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", str(photos), *BOARD]) == 0
    described_so = (photos / "session.yaml").read_text()
    assert main(["fit", str(photos), "--board", "5x4"]) == 3
    assert "session.yaml is as it was before this command" in capsys.readouterr().err
    assert (photos / "session.yaml").read_text() == described_so
    assert main(["fit", str(photos), "--square-mm", "30"]) == 0, "it is calib's own as before"


def test_a_fit_that_another_one_keeps_out_changes_no_description(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    described(str(photos), *BOARD)
    file = photos / "session.yaml"
    text = file.read_text()
    out = tmp_path / "out"
    out.mkdir()
    held = lock_folder(out)
    assert held is not None
    assert main(["fit", str(photos), "--square-mm", "40", "-o", str(out)]) == 2
    assert "session.yaml is as it was before this command" in capsys.readouterr().err
    assert file.read_text() == text
    os.close(held)

"""Recordings of other programs become sessions that calib fit calibrates."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.cli import main
from calib.corners.corners_file import read_corners, write_corners
from calib.corners.view import View
from calib.session.board import Board
from calib.session.coding import AprilGrid
from calib.session.session import Session, read_session
from tests.importing import recordings
from tests.importing.recordings import BOARD, CAMCHAIN, MATRIX, SECOND, SIZE

AND_BOARD = ["--board", "7x6", "--square-mm", "25"]


def imported(arguments: list[str], folder: Path) -> Session:
    assert main(["import", *arguments, "-o", str(folder)]) == 0
    return read_session(folder)


def check_fit(
    session: Session, focal_tolerance: float, capsys: pytest.CaptureFixture[str]
) -> dict[str, object]:
    """calib fit on the session finds the camera."""
    capsys.readouterr()
    assert main(["fit", str(session.path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    from calib.calibration import Calibration

    k = Calibration.load(session.path / "calibration").camera.intrinsics
    assert k
    assert (k.fx.value, k.fy.value) == pytest.approx(
        (MATRIX[0, 0], MATRIX[1, 1]), abs=focal_tolerance
    )
    assert isinstance(answer, dict)
    return answer


def test_mrcal_cameramodel(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session = imported(
        ["mrcal", str(recordings.cameramodel(tmp_path / "c.cameramodel"))], tmp_path / "s"
    )
    assert session.board == BOARD
    assert (session.camera.width, session.camera.height) == SIZE
    assert session.corners
    views = read_corners(session.corners, BOARD)
    assert [view.name for view in views] == [f"shot_{frame}.png" for frame in range(8)]
    for view, view_corners in zip(views, recordings.corners(), strict=True):
        assert np.nanmax(np.abs(view.corners - view_corners.reshape(-1, 2))) < 1e-9
    assert np.flatnonzero(views[2].weight == 0).tolist() == [1 * 7 + 3], (
        "mrcal's outlier is not seen"
    )
    assert views[3].weight[0] == 0.5
    text = (session.path / "session.yaml").read_text()
    assert (
        "# mrcal's own LENSMODEL_OPENCV5, for camera.intrinsics: {fx: 520.0, fy: 525.0, cx: 322.0,"
        " cy: 238.0, distortion: [-0.12" in text
    )
    assert "warped by 1.00 mm along x and -0.20 mm along y" in text
    answer = check_fit(session, 0.01, capsys)
    assert answer["frames_used"] == 8


def test_mrcal_corners(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    views = [
        View(f"img{i}.jpg", view_corners.reshape(-1, 2), np.ones(BOARD.count))
        for i, view_corners in enumerate(recordings.corners())
    ]
    write_corners(tmp_path / "found.vnl", views)
    session = imported(
        ["mrcal-corners", str(tmp_path / "found.vnl"), *AND_BOARD, "--size", "640x480"],
        tmp_path / "s",
    )
    check_fit(session, 0.01, capsys)


@pytest.mark.parametrize("source", ["ros", "kalibr", "images"])
def test_pictures(source: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Drawn without a lens; what is found is the drawn camera, but for what corners of drawn
    pictures are off.
    """
    made = {
        "ros": lambda: [str(recordings.tar(tmp_path / "calibrationdata.tar.gz")), *AND_BOARD],
        "kalibr": lambda: [str(recordings.kalibr(tmp_path / "k"))],
        "images": lambda: [str(recordings.write_pictures(tmp_path / "p")), *AND_BOARD],
    }[source]()
    session = imported([source, *made], tmp_path / "s")
    assert (
        capsys.readouterr().out
        == f"{tmp_path / 's'} has 8 pictures: calibrate it with `calib fit {tmp_path / 's'}`.\n"
    )
    assert session.board == BOARD
    assert session.camera.model == ("narrow_stereo" if source == "ros" else "")
    assert [path.name for path in session.frames] == [
        f"left-{i:04d}.png" if source == "ros" else f"shot {i}.png" for i in range(8)
    ]
    answer = check_fit(session, 2.0, capsys)
    assert answer["frames_used"] == 8


def test_kalibr_s_aprilgrid(tmp_path: Path) -> None:
    folder = recordings.kalibr(
        tmp_path / "k",
        target=(
            "target_type: 'aprilgrid'\ntagCols: 6\ntagRows: 5\ntagSize: 0.088\ntagSpacing: 0.3\n"
        ),
    )
    session = imported(["kalibr", str(folder)], tmp_path / "s")
    assert session.board == Board(12, 10, 0.088, coding=AprilGrid(0.3))
    assert np.ptp(session.board.points(), axis=0) == pytest.approx(
        [0.088 * (6 + 5 * 0.3), 0.088 * (5 + 4 * 0.3)]
    )


@pytest.mark.parametrize("source", ["ros", "images"])
def test_pictures_of_a_board_with_markers(source: str, tmp_path: Path) -> None:
    made = (
        recordings.tar(tmp_path / "calibrationdata.tar.gz")
        if source == "ros"
        else recordings.write_pictures(tmp_path / "p")
    )
    flags = ["--type", "aprilgrid", "--board", "6x5", "--tag-mm", "88", "--spacing", "0.3"]
    assert imported([source, str(made), *flags], tmp_path / "s").board == Board(
        12, 10, 0.088, coding=AprilGrid(0.3)
    )


def test_a_board_option_overrides_kalibr_s_target(tmp_path: Path) -> None:
    session = imported(
        ["kalibr", str(recordings.kalibr(tmp_path / "k")), "--board", "7x6", "--square-mm", "30"],
        tmp_path / "s",
    )
    assert session.board.square == 0.03


@pytest.mark.parametrize("side", ["left", "right"])
def test_each_camera_of_a_stereo_tar_can_be_imported(side: str, tmp_path: Path) -> None:
    archive = recordings.stereo_tar(tmp_path / "calibrationdata.tar.gz")
    session = imported(["ros", str(archive), *AND_BOARD, "--camera", side], tmp_path / "s")
    assert session.camera.model == f"narrow_stereo/{side}"
    assert [path.name for path in session.frames] == [f"{side}-{i:04d}.png" for i in range(8)]
    first = recordings.pictures()[0]
    picture = cv2.imread(str(session.frames[0]), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    assert np.array_equal(picture, first if side == "left" else first[::-1, ::-1])


def test_each_camera_of_a_kalibr_chain_can_be_imported(tmp_path: Path) -> None:
    folder = recordings.kalibr(
        tmp_path / "k", chain=CAMCHAIN + SECOND.replace("[640, 480]", "[320, 240]")
    )
    (folder / "cam1").mkdir()
    cv2.imwrite(str(folder / "cam1" / "a.png"), np.zeros((240, 320), np.uint8))
    first = imported(["kalibr", str(folder), "--camera", "cam0"], tmp_path / "first")
    second = imported(["kalibr", str(folder), "--camera", "cam1"], tmp_path / "second")
    assert ((first.camera.width, len(first.frames)), (second.camera.width, len(second.frames))) == (
        (640, 8),
        (320, 1),
    )


def test_names_of_pictures_in_a_tar_cannot_leave_the_folder(tmp_path: Path) -> None:
    archive = recordings.tar(
        tmp_path / "c.tar.gz", extra=("../../evil.png", "rear-0001.png", "../left-9999.txt")
    )
    session = imported(["ros", str(archive), *AND_BOARD], tmp_path / "in" / "s")
    assert len(session.frames) == 8
    assert sorted(path.name for path in (tmp_path / "in").iterdir()) == ["s"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.tar.gz", "in"]


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pictures = recordings.write_pictures(tmp_path / "p")
    taken = tmp_path / "taken"
    taken.mkdir()
    (taken / "mine.txt").write_text("mine")
    (tmp_path / "file").write_text("mine")
    for target in (taken, tmp_path / "file"):
        assert main(["import", "images", str(pictures), *AND_BOARD, "-o", str(target)]) == 2
        assert (
            f"{target} is there already, and no session is overwritten: give the name of a new"
            " folder with -o." in capsys.readouterr().err
        )
    assert [path.name for path in taken.iterdir()] == ["mine.txt"]
    (tmp_path / "empty").mkdir()
    imported(["images", str(pictures), *AND_BOARD], tmp_path / "empty")

"""Sessions whose boards have markers, from pictures to a calibration and back: every command that
knows a board knows these.
"""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from calib.calibration import Calibration
from calib.cli import main
from calib.corners.corners_file import read_corners, write_corners
from calib.session.board_section import board_to_yaml
from calib.session.session import read_session
from fixtures.coded_boards import CHARUCO, GRID, LENS, Kind, poses

pytestmark = pytest.mark.slow
VIEWS, HELD_OUT = 12, 4


def write(folder: Path, kind: Kind, count: int, seed: int) -> Path:
    (folder / "frames").mkdir(parents=True)
    for number, pose in enumerate(poses(count, seed, 2 * max(kind.board.half))):
        cv2.imwrite(str(folder / "frames" / f"{number}.png"), kind.view(pose, seed=number).picture)
    camera = {"width": LENS.width, "height": LENS.height}
    session = {
        "format": 1,
        "board": board_to_yaml(kind.board),
        "camera": camera,
        "cover": {"shape": "none"},
    }
    (folder / "session.yaml").write_text(yaml.safe_dump(session))
    return folder


@pytest.fixture(scope="module", params=[CHARUCO, GRID], ids=["charuco", "aprilgrid"])
def fitted(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Kind, Path]:
    kind = request.param
    folder = write(tmp_path_factory.mktemp("coded") / "session", kind, VIEWS, seed=11)
    assert main(["fit", str(folder), "--json"]) == 0
    return kind, folder


def said(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    results: dict[str, Any] = json.loads(capsys.readouterr().out)
    return results


def test_the_calibration_is_the_camera(fitted: tuple[Kind, Path]) -> None:
    """Rendered with a focal length of 480 px: corners of 0.01 px tell it to some hundredths of a
    pixel, half of them out of the picture.
    """
    kind, folder = fitted
    calibration = Calibration.load(folder / "calibration")
    intrinsics = calibration.camera.intrinsics
    assert intrinsics
    assert (intrinsics.fx.value, intrinsics.fy.value) == pytest.approx(
        (LENS.focal, LENS.focal), abs=0.3
    )
    assert (intrinsics.cx.value, intrinsics.cy.value) == pytest.approx(LENS.matrix[:2, 2], abs=0.3)
    assert calibration.board == kind.board
    assert calibration.stages[-1].rms_px < 0.02
    assert calibration.noise_px is not None
    assert calibration.noise_px < 0.02
    assert len(calibration.views) == VIEWS
    assert any(view.count < kind.board.count for view in calibration.views), (
        "some boards reach out of the picture"
    )
    report = (folder / "calibration" / "report.html").read_text(encoding="utf-8")
    assert str(kind.board) in report


def test_held_out_views(
    fitted: tuple[Kind, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kind, folder = fitted
    later_session = write(tmp_path / "other", kind, HELD_OUT, seed=12)
    assert main(["evaluate", str(folder / "calibration"), str(later_session), "--json"]) == 0
    result = said(capsys)
    assert result["frames_used"] == HELD_OUT
    assert result["rms_px"] < 0.03


@pytest.mark.usefixtures("without_figures")
def test_corners_come_back_from_their_file(
    fitted: tuple[Kind, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The measured corners, saved as corners.vnl with their gaps, give the same calibration as the
    pictures.
    """
    kind, folder = fitted
    initial = Calibration.load(folder / "calibration")
    write_corners(tmp_path / "corners.vnl", initial.views)
    read_back = read_corners(tmp_path / "corners.vnl", kind.board)
    for view, same in zip(initial.views, read_back, strict=True):
        assert np.array_equal(view.seen, same.seen)
        assert np.array_equal(view.corners[view.seen], same.corners[same.seen])
    setup = yaml.safe_load((folder / "session.yaml").read_text()) | {"corners": "corners.vnl"}
    (tmp_path / "session.yaml").write_text(yaml.safe_dump(setup))
    assert main(["fit", str(tmp_path), "--json"]) == 0
    capsys.readouterr()
    final = Calibration.load(tmp_path / "calibration")
    assert initial.camera.intrinsics
    assert final.camera.intrinsics
    assert final.camera.intrinsics.fx.value == pytest.approx(
        initial.camera.intrinsics.fx.value, rel=1e-6
    )


def test_a_point_on_a_board_that_is_partly_seen(
    fitted: tuple[Kind, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """A corner's own pixel is measured on the board's plane, as far from the camera as it was
    rendered: to a thousandth.
    """
    kind, folder = fitted
    pose = poses(VIEWS, 11, 2 * max(kind.board.half))[0]
    drawn = kind.view(pose, seed=0)
    place = cv2.Rodrigues(pose[:3])[0][:, :2] @ kind.board.points().T + pose[3:, None]
    corners = int(np.argmin(np.linalg.norm(drawn.corners - LENS.matrix[:2, 2], axis=1)))
    points = folder / "frames" / "points.csv"
    points.write_text(f"image,x,y\n0.png,{drawn.corners[corners, 0]},{drawn.corners[corners, 1]}\n")
    command = ["measure", str(folder / "calibration"), str(points), "--on-boards", "--json"]
    assert main(command) == 0
    result = said(capsys)["points"][0]
    assert result["m"] == pytest.approx(place[:, corners], abs=1e-3 * pose[5])


@pytest.mark.usefixtures("without_figures")
def test_a_diagnosis_of_a_true_model_finds_no_effect(
    fitted: tuple[Kind, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    _, folder = fitted
    assert main(["diagnose", str(folder / "calibration"), "--json"]) == 0
    results = said(capsys)
    assert results["accepted"] == []
    assert results["verdict"]["word"] == "trusted", results["verdict"]


def test_the_session_is_read_again_as_it_was_written(fitted: tuple[Kind, Path]) -> None:
    kind, folder = fitted
    assert read_session(folder).board == kind.board
    assert Calibration.load(folder / "calibration").board == kind.board

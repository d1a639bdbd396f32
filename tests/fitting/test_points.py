"""Sessions whose target is points, through the commands, against the rays of the simulation."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from calib.calibration import Calibration
from calib.cli import main
from calib.corners.point_views import views_of_points
from calib.corners.pose_requirements import find_pose_problem
from calib.errors import NotEnoughDataError
from calib.estimation.observations import Observations
from calib.fit_record.request import Settings
from calib.fitting.setup import Setup
from calib.intrinsics.calibrate import calibrate_bare
from calib.progress import Silent
from calib.session.board import Board
from calib.session.point_target import PointTarget, PointView, near_origin
from fixtures.calibrated import CAMERA, tolerant
from fixtures.map_errors import errors
from fixtures.point_sessions import (
    DEPTHS,
    POINT_NOISE,
    SCREEN_WIDTH,
    behind_pane,
    screen_scene,
    screen_views,
    write_point_session,
)
from fixtures.synthetic import HEIGHT, INTRINSICS, THIN, WIDTH, Scene, bare_views, scene

VIEWS = 6
MADE = screen_scene(1, VIEWS, 160, 100)
HELD_OUT = screen_views(
    np.random.default_rng(5), replace(MADE, board=Board(80, 50, SCREEN_WIDTH / 80)), 4
)
"""The same glass; the points are at other places of the target."""


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of points with its calibration."""
    folder = write_point_session(tmp_path_factory.mktemp("points") / "session", MADE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calib.report.write.DRAWINGS", ())  # one test looks at them
        assert main(["fit", str(folder), "--json"]) == 0
    return folder


def map_errors(made: Scene, calibration: Calibration) -> tuple[list[float], list[float]]:
    """Return the errors of the maps at three depths, and the predicted ones, px."""
    pairs = list(errors(made, calibration))
    rms = [float(np.sqrt(np.mean(error**2))) for error, _ in pairs]
    return rms, [float(np.sqrt(np.mean(sigma**2))) for _, sigma in pairs]


@pytest.mark.slow
def test_points_tell_the_glass_better_than_boards(fitted: Path) -> None:
    """Six views of a screen against 24 of a board whose corners have 0.05 px of noise."""
    rms, predicted = map_errors(MADE, Calibration.load(fitted / "calibration"))
    boards = scene(1, views=24, noise=0.05, cover=THIN, depths=DEPTHS)
    setup = Setup(boards.board, CAMERA, INTRINSICS, boards.cover)
    board_rms, board_predicted = map_errors(boards, tolerant(boards, setup, Settings()))
    print(f"points {rms} px (predicted {predicted}), boards {board_rms} ({board_predicted})")
    assert max(rms) < 0.015
    assert 0.5 < np.sqrt(np.mean(np.square(rms) / np.square(predicted))) < 1.25
    assert (2 * np.array(rms) < board_rms).all()


def test_the_residual_is_the_noise_that_the_points_state(fitted: Path) -> None:
    calibration = Calibration.load(fitted / "calibration")
    assert calibration.noise_px is not None
    assert calibration.stages[-1].rms_px < 1.2 * calibration.noise_px
    assert calibration.noise_px < 2**0.5 * POINT_NOISE


def test_the_origin_of_a_target_may_lie_anywhere() -> None:
    """An origin some metres away is moved near the points, that of a piece of a screen is not."""
    places = Board(16, 11, 0.02).points()
    far = near_origin(places + np.array([5.0, -3.0]))
    np.testing.assert_allclose(far, places, atol=1e-12)
    np.testing.assert_array_equal(near_origin(far), far)
    corner = places - places.min(0)
    np.testing.assert_array_equal(near_origin(corner), corner)
    piece = corner[corner.max(1) > 0.15]
    np.testing.assert_array_equal(near_origin(piece), piece)
    board = PointTarget.of(places + np.array([5.0, -3.0]))
    assert board.square == pytest.approx(0.03)
    assert not find_pose_problem(np.ones(len(places), np.bool_), board)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda view: replace_points(view, slice(3)), "only 3 points are seen, and a pose needs 8"),
        (lambda view: replace_points(view, slice(9)), "the points that are seen lie on one line"),
        (
            lambda view: replace(view, pixels=view.pixels / (WIDTH, HEIGHT)),
            "its pixels are fractions of the picture: give them in px",
        ),
    ],
    ids=["few", "line", "fractions"],
)
def test_the_reason_why_no_view_of_a_target_can_be_used(
    spoil: Callable[[PointView], PointView], says: str
) -> None:
    """The most frequent reason is in the message, which speaks of a target."""
    places = Board(9, 9, 0.02).points()
    covariance = np.tile(1e-4 * np.eye(2), (81, 1, 1))
    points = [
        spoil(PointView(view.name, view.corners, places, covariance))
        for view in bare_views(3, 6, 0.1)
    ]
    board = PointTarget.of(np.concatenate([view.places for view in points]))
    camera = replace(CAMERA, intrinsics=None, lens_coefficients=0)
    with pytest.raises(NotEnoughDataError) as caught:
        calibrate_bare(views_of_points(points), board, camera, Silent())
    assert f"there are 0 (6 of 6 left out: {says}" in str(caught.value)
    assert "take more views of the target" in str(caught.value)


def test_points_that_no_lens_fits_are_no_board_with_columns() -> None:
    generator = np.random.default_rng(4)
    places = Board(9, 9, 0.02).points()
    covariance = np.tile(1e-4 * np.eye(2), (81, 1, 1))
    points = [
        PointView(view.name, generator.permutation(view.corners), places, covariance)
        for view in bare_views(3, 6, 0.1)
    ]
    camera = replace(CAMERA, intrinsics=None, lens_coefficients=0)
    target = PointTarget.of(np.concatenate([places] * 6))
    with pytest.raises(NotEnoughDataError, match="No intrinsics fit these views") as caught:
        calibrate_bare(views_of_points(points), target, camera, Silent())
    assert "pixels and target of each file in points/" in str(caught.value)
    assert "board" not in str(caught.value)


def replace_points(view: PointView, rows: slice) -> PointView:
    """Return the view with some of its points alone."""
    return PointView(view.name, view.pixels[rows], view.places[rows], view.covariance[rows])


def test_a_calibration_keeps_its_points(fitted: Path, tmp_path: Path) -> None:
    calibration = Calibration.load(fitted / "calibration")
    assert isinstance(calibration.board, PointTarget)
    assert "target:\n  type: points" in (fitted / "calibration/calibration.yaml").read_text()
    calibration.save(tmp_path / "copy")
    copy = Calibration.load(tmp_path / "copy")
    assert copy.observations.whitening is not None
    torch.testing.assert_close(copy.observations.whitening, calibration.observations.whitening)
    torch.testing.assert_close(copy.observations.corners, calibration.observations.corners)


def test_held_out_points(fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Points at other places of the target are evaluated with the calibration's own."""
    held_out = write_point_session(tmp_path / "held-out", HELD_OUT, seed=1)
    calibration = str(fitted / "calibration")
    capsys.readouterr()
    assert main(["evaluate", calibration, str(held_out), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["board"]["points"] == Calibration.load(calibration).board.count
    assert answer["rms_px"] < 0.05  # some of it where no fitted view has points


@pytest.mark.slow
def test_later_points_are_checked(
    fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same glass is valid, another is not."""
    calibration = str(fitted / "calibration")
    held_out = write_point_session(tmp_path / "held-out", HELD_OUT, seed=1)
    assert main(["check", calibration, str(held_out)]) == 0
    other = write_point_session(tmp_path / "other", screen_scene(2, 4, 80, 50), seed=1)
    assert main(["check", calibration, str(other)]) == 5
    capsys.readouterr()
    assert main(["check", calibration, str(held_out), "--update"]) == 2
    assert "put the points of all views into one session" in capsys.readouterr().err


def test_an_evaluation_notices_a_wrong_point_file(
    fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The negative control: a target that is stretched by 0.3 % along x."""
    held_out = write_point_session(tmp_path / "held-out", HELD_OUT)
    for file in (held_out / "points").iterdir():
        with np.load(file) as content:
            arrays = dict(content)
        np.savez(file, **{**arrays, "target": arrays["target"] * [1.003, 1, 1]})
    capsys.readouterr()
    assert main(["evaluate", str(fitted / "calibration"), str(held_out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rms_px"] > 0.15


def test_pictures_do_not_show_points(
    fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Image.new("L", (CAMERA.width, CAMERA.height)).save(tmp_path / "0000.png")
    assert main(["evaluate", str(fitted / "calibration"), str(tmp_path)]) == 2
    assert "A target of points is not found in pictures" in capsys.readouterr().err


@pytest.mark.slow
def test_the_loop_finds_nothing_on_clean_points(
    fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diagnose", str(fitted / "calibration"), "-o", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["accepted"] == []


@pytest.mark.slow
def test_a_report_of_points_has_no_lines_of_a_board(fitted: Path) -> None:
    assert main(["report", str(fitted / "calibration")]) == 0
    page = (fitted / "calibration" / "report.html").read_text(encoding="utf-8")
    assert "views of a flat target:" in page
    assert "the rays of some of its points" in page
    assert "The cover from the side and from above" not in page


def test_the_axes_of_a_point_count_by_their_covariance() -> None:
    """Whitened errors have equal variances along all axes, the mean of both."""
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(3, 2, 2))
    covariance = roots @ roots.swapaxes(1, 2) + 0.01 * np.eye(2)
    places = rng.uniform(-1, 1, (3, 2))
    view = PointView("0000.npz", rng.uniform(0, 99, (3, 2)), places, covariance)
    other = replace(view, name="0001.npz", covariance=np.tile(np.eye(2), (3, 1, 1)))
    target = PointTarget.of(np.concatenate([places, places]))
    observations = Observations.of(views_of_points([view, other]), target)
    assert observations.whitening is not None
    whitening = observations.whitening.numpy()[:3]
    whitened = whitening @ covariance @ whitening.swapaxes(1, 2)
    means = np.trace(covariance, axis1=1, axis2=2) / 2
    np.testing.assert_allclose(whitened, means[:, None, None] * np.eye(2), atol=1e-12)
    np.testing.assert_allclose(observations.whitening.numpy()[3:], np.tile(np.eye(2), (3, 1, 1)))
    np.testing.assert_array_equal(observations.corners.numpy(), np.concatenate([places] * 2))


@pytest.mark.slow
def test_the_pane_of_a_screen_is_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twelve views of a screen with 2 mm of glass before its pixels, which nobody declared."""
    monkeypatch.setattr("calib.report.write.DRAWINGS", ())
    made = screen_scene(3, 12, 40, 25)
    folder = write_point_session(tmp_path / "s", made, places=behind_pane(made, 2e-3))
    assert main(["fit", str(folder), "--json"]) == 0
    capsys.readouterr()
    assert main(["diagnose", str(folder / "calibration"), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert "screen_glass" in answer["accepted"]
    pane = next(
        candidate for candidate in answer["candidates"] if candidate["effect"] == "screen_glass"
    )
    thickness = pane["parameters"]["screen_glass.thickness"]
    print(pane["held_out_px_before"], pane["held_out_px_after"], thickness)
    assert abs(thickness["value"] - 2e-3) < 2.5 * thickness["sigma"] < 1e-4
    assert pane["held_out_px_after"] < 0.4 * pane["held_out_px_before"]

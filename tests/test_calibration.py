"""A calibration from a session folder of known truth, saved, loaded and asked."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from calib.calibration import Calibration
from calib.camera import Camera
from calib.errors import InputError, NotEnoughDataError
from calib.fit import Settings, fit
from calib.progress import Silent
from calib.session import read_session, session_to_yaml
from calib.views import View
from calib.vnlog import write_corners
from tests.scenes import HEIGHT, INTRINSICS, WIDTH, Scene, scene

SHORT = Settings(grid=(5, 5), steps=60)


def write_session(folder: Path, made: Scene, views: tuple[View, ...] | None = None) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    setup = session_to_yaml(made.board, Camera(WIDTH, HEIGHT, intrinsics=INTRINSICS), made.cover)
    (folder / "session.yaml").write_text(yaml.safe_dump({"format": 1, **setup, "corners": "corners.vnl"}))
    write_corners(folder / "corners.vnl", views or made.views)
    return folder


@pytest.fixture(scope="module")
def made() -> Scene:
    return scene(7, views=8, amplitude=1e-5, noise=0.05)


@pytest.fixture(scope="module")
def calibration(made: Scene, tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    return fit(read_session(write_session(tmp_path_factory.mktemp("session"), made)), SHORT, Silent())


def test_every_stage_is_better_than_the_one_before(calibration: Calibration) -> None:
    assert [stage.name for stage in calibration.stages] == ["pinhole", "cover", "cover+rbf"]
    errors = [stage.rms_px for stage in calibration.stages]
    assert errors[0] > errors[1] > errors[2]
    assert calibration.stages[2].rmse_cm < calibration.stages[1].rmse_cm


def test_the_noise_is_found_from_the_residual(calibration: Calibration) -> None:
    assert calibration.noise_px == pytest.approx(0.05 * 2**0.5, rel=0.15)  # 0.05 px in x and in y, from 648 corners


def test_what_is_saved_comes_back(calibration: Calibration, tmp_path: Path) -> None:
    path = calibration.save(tmp_path / "out")
    back = Calibration.load(path)
    pixels = np.random.default_rng(0).uniform(0, [WIDTH, HEIGHT], (200, 2))
    for ours, theirs in zip(calibration.rays(pixels), back.rays(pixels), strict=True):
        assert np.abs(ours - theirs).max() < 1e-15  # millimetres in the file cost the last bit
    assert back.stages == calibration.stages
    assert back.rejected == calibration.rejected
    assert back.settings == calibration.settings
    assert [view.name for view in back.views] == [view.name for view in calibration.views]
    assert np.array_equal(back.poses, calibration.poses)
    assert all(np.array_equal(a.corners, b.corners) for a, b in zip(back.views, calibration.views, strict=True))
    assert Calibration.load(tmp_path / "out").stages == calibration.stages, "the folder serves as well as the file"


def test_a_saved_calibration_can_be_fitted_again_from_itself(calibration: Calibration, tmp_path: Path) -> None:
    """It carries its inputs: the same corners, camera and cover give the same result."""
    calibration.save(tmp_path)
    back = Calibration.load(tmp_path)
    assert back.observations.pixels.equal(calibration.observations.pixels)
    assert session_to_yaml(back.board, back.camera, back.cover) == session_to_yaml(calibration.board, calibration.camera, calibration.cover)


def test_projection_inverts_rays(calibration: Calibration) -> None:
    pixels = np.random.default_rng(1).uniform([0, 0], [WIDTH - 1, HEIGHT - 1], (300, 2))
    origins, directions = calibration.rays(pixels)
    assert np.abs(calibration.project(origins + 0.7 * directions) - pixels).max() < 1e-6


def test_maps_are_the_rays(calibration: Calibration) -> None:
    map_x, map_y = calibration.undistort_maps(depth=0.8)
    assert map_x.shape == map_y.shape == (HEIGHT, WIDTH)
    u, v = 1000, 700
    at = np.array([[(u - INTRINSICS.cx.value) / INTRINSICS.fx.value, (v - INTRINSICS.cy.value) / INTRINSICS.fy.value, 1.0]]) * 0.8
    assert np.abs(calibration.project(at)[0] - [map_x[v, u], map_y[v, u]]).max() < 0.01


def test_partly_seen_boards_are_welcome(made: Scene, tmp_path: Path) -> None:
    views = []
    for i, view in enumerate(made.views):
        hidden = np.zeros(81, dtype=bool)
        hidden[: 9 * (i % 4)] = True
        views.append(View(view.name, np.where(hidden[:, None], np.nan, view.corners), np.where(hidden, 0.0, 1.0)))
    result = fit(read_session(write_session(tmp_path, made, tuple(views))), SHORT, Silent())
    assert len(result.views) == 8
    assert sum(view.count for view in result.views) == 8 * 81 - 2 * (9 + 18 + 27)
    assert result.stages[2].rms_px < 0.15


def test_a_view_that_disagrees_is_rejected_and_listed(made: Scene, tmp_path: Path) -> None:
    wrong = made.views[3]
    swapped = wrong.corners.reshape(9, 9, 2)[[1, 0, *range(2, 9)]].reshape(81, 2)  # two rows taken for each other
    views = (*made.views[:3], View(wrong.name, swapped, wrong.weight), *made.views[4:])
    result = fit(read_session(write_session(tmp_path, made, views)), SHORT, Silent())
    assert [rejected.name for rejected in result.rejected] == [wrong.name]
    assert "do not fit" in result.rejected[0].reason or "no board pose" in result.rejected[0].reason
    assert len(result.views) == 7
    assert result.stages[2].rms_px < 0.15


def test_too_few_views_say_so(made: Scene, tmp_path: Path) -> None:
    with pytest.raises(NotEnoughDataError, match="Only 2 views are usable and a fit needs 3"):
        fit(read_session(write_session(tmp_path, made, made.views[:2])), SHORT, Silent())


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda folder: (folder / "calibration.npz").unlink(), "keep calibration.yaml and calibration.npz in one folder"),
        (lambda folder: (folder / "calibration.npz").write_bytes(b"PK\x03\x04 cut"), "is damaged"),
        (lambda folder: (folder / "calibration.yaml").write_text("format: 7\n"), "format is 7"),
        (lambda folder: (folder / "calibration.yaml").write_text("format: 1\n"), "is not a whole calibration"),
        (lambda folder: (folder / "calibration.yaml").unlink(), "does not exist"),
    ],
)
def test_a_damaged_calibration_gets_its_sentence(calibration: Calibration, tmp_path: Path, spoil: object, says: str) -> None:
    calibration.save(tmp_path)
    spoil(tmp_path)  # type: ignore[operator]
    with pytest.raises(InputError, match=says):
        Calibration.load(tmp_path)

"""A calibration from a session folder of known truth, saved, loaded and asked."""

from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from calib.apply.measure import Measurer
from calib.calibration import Calibration
from calib.calibration_content import Declared
from calib.corners.corners_file import write_corners
from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError
from calib.fit_record.history import (
    DiagnosisRecord,
    DiagnosisRun,
    History,
    MediumChange,
    UpdateRecord,
)
from calib.fit_record.outcome import (
    CrossValidation,
    FitOutcome,
    FleetPriorTest,
    Redetection,
    Uncertainty,
)
from calib.fit_record.request import CommandOptions, Settings
from calib.fit_record.shapes import RECORD
from calib.fitting.fit import fit
from calib.inference.calibration_model import base_model
from calib.progress import Silent
from calib.session.camera import Camera, Intrinsics
from calib.session.schema import Number
from calib.session.session import read_session, session_to_yaml
from calib.verdict.judge import judge
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, Scene, scene

SHORT = Settings(grid=(5, 5), steps=60)
CORRELATIONS = ((0.99,), (0.5, 0.55), (0.0, 0.0, 0.2))
BARE = Intrinsics(
    Number(2560, 3.0), Number(2559, 2.9), Number(1666, 1.5), Number(1274, 1.2), (), CORRELATIONS
)


def write_session(folder: Path, made: Scene, views: tuple[View, ...] | None = None) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    setup = session_to_yaml(made.board, Camera(WIDTH, HEIGHT, intrinsics=INTRINSICS), made.cover)
    (folder / "session.yaml").write_text(
        yaml.safe_dump({"format": 1, **setup, "corners": "corners.vnl"})
    )
    write_corners(folder / "corners.vnl", views or made.views)
    return folder


def rewrite_npz(folder: Path, **changed: np.ndarray) -> None:
    """Other arrays with the digest that belongs to them, as someone bent on it would."""
    path = folder / "calibration.npz"
    with np.load(path) as file:
        arrays = dict(file) | changed
    np.savez(path, **arrays)
    edit_yaml(
        folder, lambda message: message.update(arrays_sha256=sha256(path.read_bytes()).hexdigest())
    )


def edit_yaml(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    path = folder / "calibration.yaml"
    document = yaml.safe_load(path.read_text())
    change(document)
    path.write_text(yaml.safe_dump(document))


@pytest.fixture(scope="module")
def made() -> Scene:
    return scene(7, views=8, amplitude=1e-5, noise=0.05)


@pytest.fixture(scope="module")
def calibration(made: Scene, tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    return fit(
        read_session(write_session(tmp_path_factory.mktemp("session"), made)), SHORT, Silent()
    )


def test_every_stage_is_better_than_the_one_before(calibration: Calibration) -> None:
    assert [stage.name for stage in calibration.stages] == ["pinhole", "cover", "cover+rbf"]
    errors = [stage.rms_px for stage in calibration.stages]
    assert errors[0] > errors[1] > errors[2]
    assert calibration.stages[2].rmse_cm < calibration.stages[1].rmse_cm


def test_the_noise_is_found_from_the_residual(calibration: Calibration) -> None:
    assert calibration.noise_px == pytest.approx(
        0.05 * 2**0.5, rel=0.15
    )  # 0.05 px in x and in y, from 648 corners


def test_a_saved_calibration_is_read_as_it_was(calibration: Calibration, tmp_path: Path) -> None:
    path = calibration.save(tmp_path / "out")
    back = Calibration.load(path)
    pixels = np.random.default_rng(0).uniform(0, [WIDTH, HEIGHT], (200, 2))
    for ours, theirs in zip(calibration.rays(pixels), back.rays(pixels), strict=True):
        assert np.abs(ours - theirs).max() < 1e-15  # millimetres in the file cost the last bit
    assert back.stages == calibration.stages
    assert back.rejected == calibration.rejected
    assert back.record() == calibration.record()
    assert [view.name for view in back.views] == [view.name for view in calibration.views]
    assert np.array_equal(back.poses, calibration.poses)
    assert all(
        np.array_equal(a.corners, b.corners)
        for a, b in zip(back.views, calibration.views, strict=True)
    )
    assert Calibration.load(tmp_path / "out").stages == calibration.stages, (
        "the folder serves as well as the file"
    )


def test_the_blur_of_corners_is_saved_where_it_is_known(
    calibration: Calibration, tmp_path: Path
) -> None:
    """Corners from a file have none, as in calibrations of earlier versions."""
    assert all(view.blur is None for view in calibration.views)
    calibration.save(tmp_path / "unknown")
    with np.load(tmp_path / "unknown" / "calibration.npz") as file:
        assert "blurs" not in file
    blur = np.random.default_rng(4).uniform(0.4, 2, (81, 2))
    blur[7] = np.nan
    views = (replace(calibration.views[0], blur=blur), *calibration.views[1:])
    replace(calibration, views=views).save(tmp_path / "known")
    back = Calibration.load(tmp_path / "known")
    np.testing.assert_array_equal(np.asarray(back.views[0].blur), blur)
    assert all(view.blur is None for view in back.views[1:])


def test_a_saved_calibration_can_be_fitted_again_from_itself(
    calibration: Calibration, tmp_path: Path
) -> None:
    """A calibration carries its inputs: the same board, camera, cover, corners and settings give
    the same rays.
    """
    calibration.save(tmp_path)
    back = Calibration.load(tmp_path)
    described = session_to_yaml(
        back.board, replace(back.camera, intrinsics=back.declared.intrinsics), back.declared.cover
    )
    session = {"format": 1, **described, "corners": "corners.vnl"}
    (tmp_path / "session.yaml").write_text(yaml.safe_dump(session))
    write_corners(tmp_path / "corners.vnl", back.views)
    assert back.request.settings
    refitted = fit(read_session(tmp_path), back.request.settings, Silent())
    pixels = np.random.default_rng(2).uniform(0, [WIDTH, HEIGHT], (200, 2))
    for first, second in zip(calibration.rays(pixels), refitted.rays(pixels), strict=True):
        assert np.abs(first - second).max() < 1e-9


def test_the_priors_of_a_bare_calibration_come_back(
    calibration: Calibration, tmp_path: Path
) -> None:
    """The correlations come back as well, a doubted number's among them, and a diagnosis starts
    from the same priors. An older file has none.
    """
    replace(calibration, stated=Declared(BARE, calibration.declared.cover, ("camera.fy",))).save(
        tmp_path
    )
    back = Calibration.load(tmp_path)
    assert back.declared.intrinsics == BARE
    priors = base_model(back).priors
    assert priors.sigmas["camera.fy"] == pytest.approx(29.0)
    assert priors.correlations["camera.fy", "camera.fx"] == pytest.approx(0.099)
    assert priors.correlations["camera.cx", "camera.fx"] == 0.5
    edit_yaml(
        tmp_path, lambda document: document["declared"]["camera"]["intrinsics"].pop("correlations")
    )
    assert Calibration.load(tmp_path).declared.intrinsics == replace(BARE, correlations=())


def test_views_that_gave_the_intrinsics_count_once(calibration: Calibration) -> None:
    """Intrinsics from these views are no prior for the same views."""
    made = replace(
        calibration,
        stated=Declared(BARE, calibration.declared.cover),
        outcome=FitOutcome(intrinsics_from="views"),
    )
    priors = base_model(made).priors
    assert priors.correlations == {}
    assert priors.sigmas["camera.fx"] == pytest.approx(128.0)


def test_the_record_comes_back_equal(calibration: Calibration, tmp_path: Path) -> None:
    outcome = replace(
        calibration.outcome,
        shape_log_odds={"cone": 0.0, "dome": -12.5},
        shape_map_changes_px={"dome": 1.5},
        shape_camera_sigma={"camera.fx": 2.5},
        rival_lens={"camera.fx": 1250.5},
        medium_log_odds={"air": -20.5, "water": 0.0},
        lens_held_out_px={"0": 1.0, "12": 0.25},
        uncertainty=Uncertainty(24, 1.5, 1.25, 1.1),
        turned_boards=("0001.png",),
        half_turned_boards=("0002.png",),
        mixed_settings=("the pictures' names are those of two cameras",),
        redetections=(Redetection("0000.png", new_corners=3, refused=1, dropped=0),),
        outlier_corners={"0003.png": 2},
        cross_validation=CrossValidation(5, 0.2, 0.1, 0.01),
        fleet_prior=FleetPriorTest("prior.yaml", "00", 6, True, 0.5, "cover.inner_radius", 1.2),
    )
    assert calibration.request.settings
    request = replace(
        calibration.request,
        settings=replace(calibration.request.settings, folds=5),
        command=CommandOptions(("lens", "focal"), (0.5, 1.0)),
    )
    document = {"candidates": [], "remarks": ["none"]}
    history = History(
        medium_change=MediumChange(1.0, 1.34, 0.001, "00"),
        updates=(UpdateRecord("00", "2026-01-01", "valid", ("a", "b"), "", {"camera.fx": 0.1}),),
        diagnosis=DiagnosisRecord(document),
        diagnosis_runs=(DiagnosisRun("/a", ""), DiagnosisRun("/b", "/c")),
    )
    recorded = replace(calibration, request=request, outcome=outcome, history=history)
    recorded.save(tmp_path)
    back = Calibration.load(tmp_path)
    assert (back.request, back.outcome, back.history) == (request, outcome, history)
    assert tuple(back.record()) == tuple(RECORD)


def test_an_unknown_noise_comes_back_unknown(calibration: Calibration, tmp_path: Path) -> None:
    """The file has .nan for it, and the verdict does not compare with it."""
    path = replace(calibration, noise_px=None).save(tmp_path)
    assert "noise_px: .nan\n" in path.read_text(encoding="utf-8")
    back = Calibration.load(path)
    assert back.noise_px is None
    assert not any("noise is about" in sentence for sentence in judge(back).sentences)
    with pytest.raises(InputError, match="give noise_px"):
        Measurer(back)
    assert Measurer(back, 0.1).noise_px == 0.1


def test_projection_inverts_rays(calibration: Calibration) -> None:
    pixels = np.random.default_rng(1).uniform([0, 0], [WIDTH - 1, HEIGHT - 1], (300, 2))
    origins, directions = calibration.rays(pixels)
    assert np.abs(calibration.project(origins + 0.7 * directions) - pixels).max() < 1e-6


def test_maps_are_the_rays(calibration: Calibration) -> None:
    map_x, map_y = calibration.undistort_maps(depth=0.8)
    assert map_x.shape == map_y.shape == (HEIGHT, WIDTH)
    valid = calibration.ray_field().map_at(0.8).valid
    assert 0 < np.count_nonzero(~valid) < valid.size
    assert (map_x[~valid] == -1).all()
    assert (map_y[~valid] == -1).all()
    assert min(map_x[valid].min(), map_y[valid].min()) >= -0.5
    u, v = 1000, 700
    bare = calibration.camera.intrinsics
    assert bare
    at = (
        np.array([[(u - bare.cx.value) / bare.fx.value, (v - bare.cy.value) / bare.fy.value, 1.0]])
        * 0.8
    )
    assert np.abs(calibration.project(at)[0] - [map_x[v, u], map_y[v, u]]).max() < 0.01


def test_partly_visible_boards_are_used(made: Scene, tmp_path: Path) -> None:
    views = []
    for i, view in enumerate(made.views):
        hidden = np.zeros(81, dtype=bool)
        hidden[: 9 * (i % 4)] = True
        views.append(
            View(
                view.name,
                np.where(hidden[:, None], np.nan, view.corners),
                np.where(hidden, 0.0, 1.0),
            )
        )
    result = fit(read_session(write_session(tmp_path, made, tuple(views))), SHORT, Silent())
    assert len(result.views) == 8
    assert sum(view.count for view in result.views) == 8 * 81 - 2 * (9 + 18 + 27)
    assert result.stages[2].rms_px < 0.15


def test_a_view_that_disagrees_is_rejected_and_listed(made: Scene, tmp_path: Path) -> None:
    wrong = made.views[3]
    swapped = wrong.corners.reshape(9, 9, 2)[[1, 0, *range(2, 9)]].reshape(
        81, 2
    )  # two rows taken for each other
    views = (*made.views[:3], View(wrong.name, swapped, wrong.weight), *made.views[4:])
    result = fit(read_session(write_session(tmp_path, made, views)), SHORT, Silent())
    assert [rejected.name for rejected in result.rejected] == [wrong.name]
    assert "do not fit" in result.rejected[0].reason or "no board pose" in result.rejected[0].reason
    assert len(result.views) == 7
    assert result.stages[2].rms_px < 0.15


def test_too_few_views_get_a_sentence(made: Scene, tmp_path: Path) -> None:
    with pytest.raises(NotEnoughDataError, match="A fit needs 3 usable views and there are 2"):
        fit(read_session(write_session(tmp_path, made, made.views[:2])), SHORT, Silent())


def test_more_folds_than_views(made: Scene, tmp_path: Path) -> None:
    with pytest.raises(NotEnoughDataError, match="9 folds need as many poses of the board"):
        fit(read_session(write_session(tmp_path, made)), replace(SHORT, folds=9), Silent())

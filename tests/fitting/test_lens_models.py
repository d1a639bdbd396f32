"""Lenses that are not OpenCV's polynomial: found from views, chosen on held-out views, and carried
to the files.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import yaml
from scipy.stats import chi2

from calib.calibration import Calibration
from calib.corners.corners_file import write_corners
from calib.corners.view import View
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses
from calib.export.central import best_central
from calib.export.formats import COLMAP, ROS
from calib.fit_record.request import Settings
from calib.fitting.evaluate import evaluate
from calib.fitting.fit import fit
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.intrinsics.calibrate import calibrate_bare
from calib.intrinsics.ray_lens import PLAIN, SPLINES
from calib.intrinsics.ray_lens_fit import fit_lens
from calib.optics.build import covered_path, pinhole_path
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.progress import Silent
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import Cover
from calib.session.lens import AUTO, FISHEYE, OPENCV
from calib.session.schema import Number
from calib.session.session import read_session
from calib.threads import single_thread
from fixtures.synthetic import HEIGHT, WIDTH, bare_views
from fixtures.wide import BOARD, CAMERA, INTRINSICS, uneven_views, wide_views

NOISE = 0.1
DOME = {
    name: Number(value)
    for name, value in {
        "inner_radius": 0.05,
        "centre.x": 0.0,
        "centre.y": 0.0,
        "centre.z": -0.02,
        "thickness": 0.003,
        "refractive_index": 1.49,
        "outside_index": 1.333,
    }.items()
}
TRUE = np.array(
    [
        n.value
        for n in (
            INTRINSICS.fx,
            INTRINSICS.fy,
            INTRINSICS.cx,
            INTRINSICS.cy,
            *INTRINSICS.distortion,
        )
    ]
)


def found(seed: int, lens: str = FISHEYE, views: int = 20) -> Intrinsics:
    return calibrate_bare(
        wide_views(seed, views, NOISE), BOARD, replace(CAMERA, lens=lens), Silent()
    ).intrinsics


def session(folder: Path, views: tuple[View, ...], **camera: object) -> Path:
    folder.mkdir()
    document = {
        "format": 1,
        "board": {"columns": BOARD.columns, "rows": BOARD.rows, "square_mm": 1000 * BOARD.square},
        "camera": {"width": CAMERA.width, "height": CAMERA.height, **camera},
        "cover": {"shape": "none"},
        "corners": "corners.vnl",
    }
    (folder / "session.yaml").write_text(yaml.safe_dump(document))
    write_corners(folder / "corners.vnl", views)
    return folder


@pytest.mark.slow
def test_errors_scatter_as_the_covariance_says() -> None:
    """Along each of the eight directions in which errors are independent the mean square is 1,
    within what chance leaves in one of ten thousand.
    """
    draws, whitened = 16, []
    for seed in range(draws):
        intrinsics = found(seed)
        numbers = (
            intrinsics.fx,
            intrinsics.fy,
            intrinsics.cx,
            intrinsics.cy,
            *intrinsics.distortion,
        )
        correlation = np.eye(len(numbers))
        for i, row in enumerate(intrinsics.correlations, 1):
            correlation[i, :i] = correlation[:i, i] = row
        power, directions = np.linalg.eigh(correlation)
        error = (np.array([n.value for n in numbers]) - TRUE) / [n.sigma for n in numbers]
        whitened.append(directions.T @ error / np.sqrt(power))
    squares = np.mean(np.square(whitened), 0)
    print(squares.round(2))
    low = chi2.ppf(5e-05, draws) / draws
    high = chi2.ppf(1 - 5e-05, draws) / draws
    assert ((low < squares) & (squares < high)).all()


@pytest.mark.slow
def test_auto_takes_the_fisheye_model_if_opencv_s_predicts_worse() -> None:
    fitted = calibrate_bare(wide_views(1, 20, NOISE), BOARD, replace(CAMERA, lens=AUTO), Silent())
    print(fitted.held_out_px)
    assert fitted.intrinsics.model == FISHEYE
    assert fitted.held_out_px[FISHEYE] == pytest.approx(NOISE * 2**0.5, rel=0.1)  # 700 corners
    assert fitted.held_out_px[FISHEYE] < 0.95 * min(
        error for name, error in fitted.held_out_px.items() if name.isdigit()
    )


@pytest.mark.slow
def test_auto_keeps_opencv_s_model_for_a_usual_lens() -> None:
    """A fisheye has no tangential part."""
    views = bare_views(2, 12, NOISE, (-0.05, 0.01, 1e-3, -5e-4, 0.004))
    fitted = calibrate_bare(views, Board(9, 9, 0.020), Camera(WIDTH, HEIGHT, lens=AUTO), Silent())
    assert fitted.intrinsics.model == OPENCV
    assert fitted.held_out_px[FISHEYE] > min(fitted.held_out_px.values())


def test_a_spline_fits_an_uneven_lens_and_stays_flat_for_an_even_one() -> None:
    """Fitted to 30 views and judged on 30 others: with waves of a pixel the error comes down
    from 0.22 px to the noise, up to a tenth; without any it stays where it is, within 1 %."""
    size = CAMERA.width, CAMERA.height
    for waves, ratio_limit in ((1.0, 1.4), (0.0, 0.99)):
        training_views, test_views = (
            uneven_views(1, 30, NOISE, waves),
            uneven_views(2, 30, NOISE, waves),
        )
        plain = fit_lens(PLAIN, training_views, BOARD, size)
        splined = fit_lens(SPLINES[1], training_views, BOARD, size, plain)
        formula_error = float(np.sqrt((plain.errors(test_views, BOARD) ** 2).mean()))
        spline_error = float(np.sqrt((splined.errors(test_views, BOARD) ** 2).mean()))
        print(f"{waves} px: {formula_error:.4f} to {spline_error:.4f} px")
        assert formula_error / spline_error > ratio_limit
        assert spline_error < 1.1 * NOISE * 2**0.5


@pytest.mark.slow
def test_a_splined_lens_is_chosen_saved_and_read(tmp_path: Path) -> None:
    """Held-out views choose the lens. A central format without splines fits its own lens and states
    the misfit.
    """
    folder = session(tmp_path / "session", uneven_views(3, 24, NOISE, 1.0), lens="splined")
    calibration = fit(read_session(folder), Settings(), Silent())
    read_back = Calibration.load(calibration.save(tmp_path / "out"))
    assert read_back.camera == calibration.camera
    assert read_back.camera.intrinsics
    assert read_back.camera.intrinsics.spline
    assert set(read_back.outcome.lens_held_out_px or ()) <= set(map(str, SPLINES))
    second_session = session(tmp_path / "others", uneven_views(4, 10, NOISE, 1.0))
    assert evaluate(read_back, read_session(second_session), Silent()).rms_px < 1.2 * NOISE * 2**0.5
    pixels = np.random.default_rng(0).uniform(
        [0, 0], [CAMERA.width - 1, CAMERA.height - 1], (500, 2)
    )
    _, directions = read_back.rays(pixels)
    assert np.abs(read_back.project(0.5 * directions) - pixels).max() < 1e-6
    model = best_central(read_back, 0.5, [lens for lens in ROS if lens.fisheye])
    assert 0.05 < model.misfit_at_depth.rms_px < 2, "what the spline is there for"


def test_a_fisheye_goes_all_the_way(tmp_path: Path) -> None:
    """Fitted, saved, read again: its rays are the true ones up to a rotation's gauge, which fixed
    axes leave at the noise; its pixels come back; its undistorted picture is a pinhole's; and the
    formats that have this lens have it exactly.
    """
    folder = session(tmp_path / "session", wide_views(5, 20, NOISE), lens="fisheye")
    calibration = fit(read_session(folder), Settings(), Silent())
    read_back = Calibration.load(calibration.save(tmp_path / "out"))
    assert read_back.camera == calibration.camera
    assert read_back.camera.intrinsics
    assert read_back.camera.intrinsics.model == FISHEYE
    assert evaluate(read_back, read_session(folder), Silent()).rms_px == pytest.approx(
        NOISE * 2**0.5, rel=0.1
    )

    pixels = np.random.default_rng(0).uniform(
        [20, 20], [CAMERA.width - 21, CAMERA.height - 21], (500, 2)
    )
    _, directions = read_back.rays(pixels)
    assert np.isfinite(directions).all()
    assert np.abs(read_back.project(0.5 * directions) - pixels).max() < 1e-6
    k = INTRINSICS
    matrix = np.array([[k.fx.value, 0, k.cx.value], [0, k.fy.value, k.cy.value], [0, 0, 1]])
    ahead = directions[:, 2] > 0.2
    true = cv2.fisheye.projectPoints(
        directions[ahead, None], np.zeros(3), np.zeros(3), matrix, TRUE[4:]
    )[0].reshape(-1, 2)
    assert np.sqrt(((true - pixels[ahead]) ** 2).sum(-1).mean()) < 3 * NOISE

    x, y = read_back.undistort_maps(1.0)
    rows, columns = np.mgrid[300:500:50, 300:500:50].reshape(2, -1)
    intrinsics = read_back.camera.intrinsics
    straight = np.column_stack(
        [
            (columns - intrinsics.cx.value) / intrinsics.fx.value,
            (rows - intrinsics.cy.value) / intrinsics.fy.value,
            np.ones(len(rows)),
        ]
    )
    assert (
        np.abs(
            np.column_stack([x[rows, columns], y[rows, columns]]) - read_back.project(straight)
        ).max()
        < 0.01
    )

    for lenses in (ROS, COLMAP):
        model = best_central(read_back, 0.5, lenses)
        assert model.lens.fisheye
        assert model.distortion == tuple(number.value for number in intrinsics.distortion)
        assert model.misfit_at_depth.worst_px < 1e-6


def test_numbers_that_a_session_states_are_held(tmp_path: Path) -> None:
    stated = {
        "model": "fisheye",
        "fx": 300.0,
        "fy": 301.5,
        "cx": 425.0,
        "cy": 391.0,
        "distortion": list(TRUE[4:].tolist()),
    }
    folder = session(tmp_path / "session", wide_views(6, 8, NOISE), intrinsics=stated)
    calibration = fit(read_session(folder), Settings(), Silent())
    assert calibration.camera.intrinsics
    assert [number.value for number in calibration.camera.intrinsics.distortion] == TRUE[
        4:
    ].tolist()
    assert calibration.stages[0].rms_px == pytest.approx(NOISE * 2**0.5, rel=0.15)


def test_behind_a_dome_a_fisheye_is_estimated_with_the_cover() -> None:
    """Lens and dome are declared wrong, each by half its tolerance: the focal length by 1 %, the
    centre by 1 mm. They trade; but within four of their own sigmas both are right, and the corners
    are fitted to their noise.
    """
    dome = Cover("dome", DOME)
    path, values = covered_path(INTRINSICS, dome)
    points, rng, views = torch.from_numpy(BOARD.points()), np.random.default_rng(4), []
    for view in wide_views(7, 14, 0.0):
        pose = pinhole_poses(*pinhole_path(INTRINSICS), Observations.of([view], BOARD))[0]
        pixels = project(path, values, path.place(points, values, pose, MIDDLE), MIDDLE).numpy()
        visible = np.isfinite(pixels).all(-1) & (
            (pixels > 0) & (pixels < [CAMERA.width - 1, CAMERA.height - 1])
        ).all(-1)
        pixels = np.where(visible[:, None], pixels + rng.normal(0, NOISE, pixels.shape), np.nan)
        views.append(View(view.name, pixels, visible.astype(np.float64)))
    longer = replace(
        INTRINSICS, fx=Number(1.01 * INTRINSICS.fx.value), fy=Number(1.01 * INTRINSICS.fy.value)
    )
    error = Cover("dome", {**DOME, "centre.z": Number(DOME["centre.z"].value + 1e-3)})
    setup = Setup(BOARD, CAMERA, longer, error).with_tolerances(Settings())
    with single_thread():
        fitted = fit_stages(setup, Observations.of(views, BOARD), Settings(grid=(3, 3)), Silent())
    assert fitted.joint
    estimates = fitted.joint.estimates()
    for name, true in (
        ("camera.fx", INTRINSICS.fx),
        ("camera.kb1", INTRINSICS.distortion[0]),
        ("cover.centre.z", DOME["centre.z"]),
    ):
        print(name, estimates[name])
        assert abs(estimates[name].value - true.value) < 4 * estimates[name].sigma, name
    assert estimates["camera.kb1"].sigma < 0.05, "half of what was left open"
    assert fitted.stages[-1].rms_px == pytest.approx(NOISE * 2**0.5, rel=0.15)
    assert fitted.stages[0].rms_px > 5 * NOISE, "without the dome"

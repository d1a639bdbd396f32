"""Whether maps are as sure as they say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from calib.apply.asked_depths import describe_unsupported
from calib.apply.map_uncertainty import describe_sigmas, map_sigmas, predicted_sigma
from calib.calibration import Calibration
from calib.export.npz import write_npz
from calib.fit_record.request import Settings
from calib.fitting.corner_range import corners_at
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.io.file_set import FileSet
from calib.optics.exposure import MIDDLE
from calib.progress import Silent
from calib.session.freeing import free_parameters
from calib.session.schema import Number
from fixtures.calibrated import CAMERA, GLASS, calibrate
from fixtures.map_errors import errors
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, Scene, scene

REPEATS = 12


@pytest.fixture(scope="module")
def made() -> Scene:
    return scene(100, 20, (4, 4), 1e-5, 0.1, cover=GLASS)


@pytest.fixture(scope="module")
def calibration(made: Scene) -> Calibration:
    return calibrate(made, Settings(grid=(8, 8)))


@pytest.mark.slow
def test_errors_are_as_large_as_predicted() -> None:
    """The mean square of a dozen repeats scatters by a fifth or so; fifty are in
    benchmarks/uncertainty.py.
    """
    squares = []
    for seed in range(200, 200 + REPEATS):
        drawn = scene(seed, 20, (4, 4), 1e-5, 0.1, cover=GLASS)
        ratios = [
            error / sigma for error, sigma in errors(drawn, calibrate(drawn, Settings(grid=(8, 8))))
        ]
        squares.append(np.mean(np.square(ratios)))
    assert 0.8 < np.sqrt(np.mean(squares)) < 1.25


def test_sigma_does_not_include_a_wrong_focal_length(made: Scene) -> None:
    """The negative control: what the fit is overconfident and does not doubt, its sigma cannot
    know.
    """
    k = INTRINSICS
    wrong = replace(
        k, fx=replace(k.fx, value=1.02 * k.fx.value), fy=replace(k.fy, value=0.98 * k.fy.value)
    )
    setup = Setup(made.board, replace(CAMERA, intrinsics=wrong), wrong, made.cover)
    fitted = fit_stages(setup, made.observations, Settings(grid=(8, 8)), Silent())
    assert fitted.joint
    overconfident = replace(
        calibrate(made, Settings(grid=(8, 8))),
        camera=setup.camera,
        amplitudes=fitted.values["relief.amplitudes"].numpy(),
        poses=fitted.poses.numpy(),
        covariance=fitted.joint.covariance.numpy(),
    )
    assert all(
        np.sqrt(np.mean(np.square(error / sigma))) > 1.5
        for error, sigma in errors(made, overconfident)
    )


@pytest.mark.slow
def test_the_variance_equals_the_scatter_of_drawn_parameters(calibration: Calibration) -> None:
    """Monte Carlo: draw amplitudes from the covariance, trace their rays, take out the motion as
    the benchmark does.
    """
    rng = np.random.default_rng(0)
    truth, values = calibration.model()
    centre = np.array([[WIDTH / 2, HEIGHT / 2], [600.0, 500.0]])
    corners = calibration.observations.pixels.numpy()
    depth = truth.place(
        calibration.observations.corners,
        values,
        torch.from_numpy(calibration.poses)[calibration.observations.view],
        MIDDLE,
    )[:, 2].numpy()
    from fixtures.map_errors import motions, rays_of, seen_at

    at = np.full(2, 0.8)
    corner_rays = rays_of(truth, values, corners)
    centre_rays = rays_of(truth, values, centre)
    motion_of_corners = motions(*corner_rays, depth)
    scatter = []
    for _ in range(300):
        drawn = rng.multivariate_normal(
            calibration.amplitudes.ravel(), calibration.covariance, method="eigh"
        )
        moved = {
            **values,
            "relief.amplitudes": torch.from_numpy(drawn.reshape(calibration.amplitudes.shape)),
        }
        target = rays_of(truth, moved, corners)
        motion = np.linalg.lstsq(
            motion_of_corners,
            (seen_at(*target, depth) - seen_at(*corner_rays, depth)).ravel(),
            rcond=None,
        )[0]
        target = rays_of(truth, moved, centre)
        scatter.append(
            seen_at(*target, at)
            - seen_at(*centre_rays, at)
            - (motions(*centre_rays, at) @ motion).reshape(-1, 2)
        )
    field = predicted_sigma(calibration)
    assert field
    ours = field.at(centre[:, :1], centre[:, 1:], 0.8)[:, 0]
    theirs = np.sqrt((np.array(scatter) ** 2).sum(-1).mean(0))
    assert ours == pytest.approx(
        theirs, rel=0.15
    )  # 300 draws: 4 %; linear between nodes: some more


def test_maps_carry_their_sigma(calibration: Calibration, tmp_path: Path) -> None:
    with FileSet(tmp_path) as files:
        write_npz(calibration, [0.6], files, Silent())
        files.commit()
    with np.load(tmp_path / "map_0.6m.npz") as made:
        assert made["sigma"].shape == made["map_x"].shape
        assert np.array_equal(np.isfinite(made["sigma"]), made["valid"])
        y, x = 1200, 1600
        sigma = float(made["sigma"][y, x])
        column, row = made["map_x"][y, x], made["map_y"][y, x]
    with np.load(tmp_path / "rays.npz") as field:
        nearest = (
            np.abs(field["sigma_y"] - row).argmin(),
            np.abs(field["sigma_x"] - column).argmin(),
        )
        variance = field["variance"][nearest]
    assert sigma == pytest.approx(np.sqrt(variance @ [1, 1 / 0.6, 1 / 0.36]), rel=0.1)


@pytest.mark.slow
def test_errors_of_freed_parameters_agree_with_their_sigmas() -> None:
    """Priors whose means are drawn around the truth.

    Sixteen numbers, two or three of a kind in one fit: 1 within a third or so.
    """
    deviations = []
    for seed in range(500, 504):
        drawn = scene(seed, 20, (4, 4), 1e-5, 0.1, cover=GLASS)
        rng = np.random.default_rng(seed)
        free, _ = free_parameters(INTRINSICS, GLASS, ("intrinsics",))
        names = ("fx", "fy", "cx", "cy")
        fx = Number(rng.normal(free.fx.value, free.fx.sigma), free.fx.sigma)
        fy = Number(rng.normal(free.fy.value, free.fy.sigma), free.fy.sigma)
        cx = Number(rng.normal(free.cx.value, free.cx.sigma), free.cx.sigma)
        cy = Number(rng.normal(free.cy.value, free.cy.sigma), free.cy.sigma)
        intrinsics = replace(free, fx=fx, fy=fy, cx=cx, cy=cy)
        setup = Setup(drawn.board, replace(CAMERA, intrinsics=intrinsics), intrinsics, GLASS)
        result = fit_stages(setup, drawn.observations, Settings(grid=(6, 6)), Silent())
        assert result.joint
        ended = result.joint.estimates()
        deviations += [
            (ended[f"camera.{name}"].value - getattr(INTRINSICS, name).value)
            / ended[f"camera.{name}"].sigma
            for name in names
        ]
    assert 0.5 < np.sqrt(np.mean(np.square(deviations))) < 1.6


def test_a_freed_index_makes_maps_less_certain(made: Scene, calibration: Calibration) -> None:
    """Both covariances are those of independent corners."""
    intrinsics, cover = free_parameters(INTRINSICS, made.cover, ("index", "intrinsics"))
    setup = Setup(made.board, CAMERA, intrinsics, cover)
    held_setup = Setup(made.board, CAMERA, INTRINSICS, made.cover)
    result = fit_stages(setup, made.observations, Settings(grid=(8, 8)), Silent())
    held = fit_stages(held_setup, made.observations, Settings(grid=(8, 8)), Silent())
    assert result.joint
    assert held.joint
    free = replace(
        calibration,
        camera=replace(CAMERA, intrinsics=intrinsics),
        cover=cover,
        covariance=result.joint.covariance.numpy(),
    )
    sure = predicted_sigma(replace(calibration, covariance=held.joint.covariance.numpy()))
    less = predicted_sigma(free)
    assert sure
    assert less
    x, y = np.full((1, 1), 1600.0), np.full((1, 1), 1200.0)
    assert less.at(x, y, 0.3) > sure.at(x, y, 0.3)


def test_a_depth_without_boards_gets_the_expected_error_of_its_maps(
    calibration: Calibration,
) -> None:
    (sentence,) = describe_unsupported(calibration, [0.05, 500.0])
    sigmas = map_sigmas(calibration, [0.05, 500.0])
    assert sentence.endswith(
        "Expected error of the maps (sigma):"
        f" {sigmas[0.05]:.2g} px at 0.05 m, {sigmas[500.0]:.2g} px at 500 m."
    )
    fixed = replace(calibration, covariance=np.zeros((0, 0)))
    (sentence,) = describe_unsupported(fixed, [0.05, 500.0])
    assert "sigma" not in sentence
    near, far = np.quantile(corners_at(calibration)[:, 2], [0.0, 1.0])
    assert map_sigmas(calibration, [0.05])[0.05] > map_sigmas(calibration, [near])[near]
    assert not list(describe_unsupported(calibration, [near, far]))


def test_a_depth_where_no_board_was_is_marked() -> None:
    text = describe_sigmas({0.2: 0.02, 0.3: 0.01, 1.2: 0.011}, (0.3, 1.1))
    marked = [part.endswith("m (no board was there)") for part in text.split(", ")]
    assert marked == [True, False, True]
    assert "board" not in describe_sigmas({0.2: 0.02})

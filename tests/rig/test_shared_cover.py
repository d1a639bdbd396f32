"""One window before several cameras."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from calib.estimation.camera_model import CameraModel
from calib.estimation.stated_priors import priors_of
from calib.optics.build import covered_path, with_relief
from calib.optics.exposure import MIDDLE
from calib.optics.relief import AMPLITUDES, Relief
from calib.rig.evaluate_rig import evaluate_rig
from calib.rig.fit_rig import fit_rig
from calib.rig.judge import judge_rig
from calib.rig.poses import compose, invert_poses, move_points
from calib.rig.rig import Rig
from calib.rig.shared_cover import cover_in_camera, relief_in_camera, share_cover
from calib.session.camera import Camera
from fixtures.rigs import SimulatedRig, plane_from, simulate_rig
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH
from tests.rig.conftest import BOARD, EVEN, WINDOW

MOUNTINGS = {
    "first": torch.tensor([0.02, -0.03, 0.01, 0.01, 0.002, -0.003], dtype=torch.float64),
    "second": torch.tensor([-0.04, 0.05, 0.3, -0.06, 0.001, 0.002], dtype=torch.float64),
}
PIXELS = torch.cartesian_prod(
    torch.linspace(100, WIDTH - 100, 7, dtype=torch.float64),
    torch.linspace(100, HEIGHT - 100, 5, dtype=torch.float64),
)
CAMERA = Camera(WIDTH, HEIGHT, intrinsics=INTRINSICS)


def model(relief: bool = False) -> CameraModel:
    path, values = covered_path(INTRINSICS, WINDOW)
    if relief:
        path = with_relief(path, Relief((-0.02, -0.03), (0.02, 0.03), (12, 12)))
        waves = np.cos(np.linspace(0, 5, 12))[:, None] + np.sin(np.linspace(0, 4, 12))
        values[AMPLITUDES] = torch.from_numpy(1e-5 * waves)
    return CameraModel(path, values, priors_of(INTRINSICS, WINDOW, path))


@pytest.mark.parametrize("first", ["first", ""])
def test_the_rays_are_those_through_the_same_plane(first: str) -> None:
    """Oracle: the plane's normal and distance, turned by hand into the second camera's frame."""
    shared = share_cover("second", model(), first, model(), MOUNTINGS)
    rays = shared.path.trace(PIXELS, shared.means, MIDDLE)
    frame = MOUNTINGS["first"] if first else torch.zeros(6, dtype=torch.float64)
    to_camera = compose(MOUNTINGS["second"], invert_poses(frame))
    path, values = covered_path(INTRINSICS, plane_from(WINDOW, to_camera))
    own_rays = path.trace(PIXELS, values, MIDDLE)
    assert int(rays.failure.max()) == 0
    ahead = (rays.origin + rays.direction).stacked()
    for place, expected in (
        (rays.origin.stacked(), own_rays.origin.stacked()),
        (ahead, (own_rays.origin + own_rays.direction).stacked()),
    ):
        assert float((move_points(to_camera, place) - expected).abs().max()) < 1e-12
    points = move_points(
        invert_poses(to_camera), own_rays.origin.stacked() + own_rays.direction.stacked()
    )
    pixels = shared.path.lens.project(points, shared.means)
    bare = path.lens.project(move_points(to_camera, points), values)
    assert float((pixels - bare).abs().max()) < 1e-8
    again = cover_in_camera(CAMERA, WINDOW, shared.path, shared.means, to_camera)
    expected_cover = plane_from(WINDOW, to_camera)
    for name, number in again.parameters.items():
        assert abs(number.value - expected_cover.parameters[name].value) < 1e-9, name


def test_a_relief_is_described_in_the_other_cameras_chart(fitted: Rig) -> None:
    mountings = {**MOUNTINGS, "second": MOUNTINGS["second"].clone()}
    mountings["second"][2] = 0.05
    shared = share_cover("second", model(), "", model(relief=True), mountings)
    cover = plane_from(WINDOW, mountings["second"])
    calibration = replace(
        fitted.calibrations["left"],
        camera=CAMERA,
        cover=cover,
        relief=None,
        covariance=np.zeros((0, 0)),
    )
    relief, amplitudes = relief_in_camera(calibration, shared.path, shared.means)
    uneven = replace(calibration, relief=relief, amplitudes=amplitudes)
    path, values = uneven.model()
    own_rays = path.trace(PIXELS, values, MIDDLE)
    rays = shared.path.trace(PIXELS, shared.means, MIDDLE)
    even, even_values = calibration.model()
    flat = even.trace(PIXELS, even_values, MIDDLE)
    turned = move_points(mountings["second"], rays.direction.stacked()) - mountings["second"][3:]
    off = (turned - own_rays.direction.stacked()).norm(dim=-1)
    effect = (turned - flat.direction.stacked()).norm(dim=-1)
    assert float(effect.max()) > 1e-4
    assert float(off.max()) < 0.05 * float(effect.max())


@pytest.fixture(scope="module")
def rig() -> SimulatedRig:
    assert WINDOW.medium
    window = WINDOW.replace_medium(replace(WINDOW.medium, exact=True), None)
    return simulate_rig(31, window, placements=12, amplitude=0.0, board=BOARD, shared=True)


@pytest.mark.slow
def test_a_pair_behind_one_window(rig: SimulatedRig, tmp_path: Path) -> None:
    file = rig.write(tmp_path, shared_cover=[["left", "right"]])
    made = fit_rig(file, EVEN)
    made.save(tmp_path / "out")
    loaded = Rig.load(tmp_path / "out")
    points, pixels = rig.points(1, 40)
    pairs = np.arange(40).reshape(-1, 2)
    true = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=-1)
    for result in (made, loaded):
        length, sigma = result.distances(pixels, pairs, 0.0)
        normalised = (length - true) / sigma
        assert 0.3 < np.sqrt(np.mean(normalised**2)) < 1.7
        projected = result.project(points)
        assert np.abs(projected["right"] - pixels["right"]).max() < 100
    assert evaluate_rig(loaded, file).rms_px < 0.16
    apart = fit_rig(rig.write(tmp_path / "apart"), EVEN)
    assert len(made.covariance) < len(apart.covariance), "one set of numbers"
    own_rays = made.calibrations["right"]
    own_pixels = own_rays.project(np.array([[0.1, 0.05, 0.8]]))
    to_reference = invert_poses(torch.from_numpy(made.mountings[1]))
    in_reference = move_points(to_reference, torch.tensor([[0.1, 0.05, 0.8]]).double()).numpy()
    assert np.abs(own_pixels - made.project(in_reference)["right"]).max() < 1e-6
    shared_lengths, _ = made.distances(pixels, pairs, 0.0)
    apart_lengths, other_sigma = apart.distances(pixels, pairs, 0.0)
    _, shared_sigma = made.distances(pixels, pairs, 0.0)
    assert np.median(shared_sigma / other_sigma) < 1.0, (
        "the window's numbers are known twice as well"
    )
    assert np.sqrt(np.mean((shared_lengths - true) ** 2)) < 3 * np.sqrt(
        np.mean((apart_lengths - true) ** 2)
    )


@pytest.mark.parametrize("shared", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_stated_distance_that_the_pictures_contradict_is_not_used(
    rig: SimulatedRig, tmp_path: Path, shared: bool
) -> None:
    """It is named, and the calibration is that without it; a true one stays."""
    keys = {"shared_cover": [["left", "right"]]} if shared else {}
    true = float(rig.cameras["right"].mounting[3:].norm())
    stated = {"value": 1e3 * true + 5, "sigma": 0.01}
    wrong = fit_rig(rig.write(tmp_path / "wrong", baseline_mm=stated, **keys), EVEN)
    free = fit_rig(rig.write(tmp_path / "free", **keys), EVEN)
    (baseline,), (free_baseline,) = wrong.baselines, free.baselines
    assert abs(baseline.metres - free_baseline.metres) < 0.1 * free_baseline.sigma
    verdict = judge_rig(wrong)
    assert any("by the pictures alone, and rig.yaml says" in line for line in verdict.sentences)
    assert not any("moved" in line for line in verdict.sentences)
    right = {"value": 1e3 * true, "sigma": 0.01}
    informed = fit_rig(rig.write(tmp_path / "right", baseline_mm=right, **keys), EVEN)
    assert informed.baselines[0].sigma < free_baseline.sigma
    assert not any("rig.yaml says" in line for line in judge_rig(informed).sentences)

"""The two housings of Calibmar's own tests, in water: a decentred dome and an oblique flat port.

Source: https://github.com/MDSKiel/calibmar, tests/calibrators/housing_calibrator_test.cpp, which
has the housings, the sizes of pictures and boards, the estimated numbers and their starts. The
poses here are its poses in round numbers; those of the dome follow from its corners. Its air has an
index of 1.003. Only ratios of indices bend light: all indices over that of air give the same
pictures, with 1 inside, as this project has it.

What Calibmar holds is declared exactly, and what it estimates with its start and a wide tolerance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.corners.view import View
from calib.fit_record.request import Settings
from calib.fitting.setup import Setup
from calib.optics.build import covered_path
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import EVEN, Cover
from calib.session.schema import Number
from fixtures.calibrated import calibrated
from fixtures.synthetic import Scene

Array = NDArray[np.float64]

AIR = 1.003
GLASS = 1.473 / AIR
WATER = 1.333 / AIR
NOISE = 0.125
"""px per axis"""
SEEDS = range(20)
MAX_DEVIATION = 2.5
"""Standard deviations: 95 % of the errors must not exceed this."""


def camera(width: int, height: int, focal: float) -> Camera:
    """Return a pinhole camera, in px, whose principal point is the middle."""
    focal_length = Number(focal, exact=True)
    cx = Number(width / 2, exact=True)
    cy = Number(height / 2, exact=True)
    intrinsics = Intrinsics(focal_length, focal_length, cx, cy)
    return Camera(width, height, intrinsics=intrinsics)


@dataclass(frozen=True)
class Housing:
    """A camera behind its port, and what a session says of it."""

    shape: str
    board: Board
    camera: Camera
    known: Mapping[str, float]
    """The cover's numbers that are declared exactly, m."""
    true: Mapping[str, float]
    """The numbers that a fit estimates, m and rad."""
    start: Mapping[str, Number]
    """The same numbers as the session declares them, m and rad."""
    poses: Array
    """(V, 6): rotation vector of the board, rad, and place of its middle, m, in the camera frame.
    """

    @property
    def scene(self) -> Scene:
        """The pictures without noise. A corner outside of a picture is not visible in it."""
        assert self.camera.intrinsics
        cover = self.cover({name: Number(value) for name, value in self.true.items()})
        path, values = covered_path(self.camera.intrinsics, cover)
        corners = torch.from_numpy(self.board.points())
        poses = torch.from_numpy(self.poses)
        views: list[View] = []
        for pose in poses:
            points = path.place(corners, values, pose, MIDDLE)
            pixels = project(path, values, points, MIDDLE).numpy()
            size = self.camera.width, self.camera.height
            visible = ((pixels > 0) & (pixels < size)).all(1)
            pixels[~visible] = np.nan
            views.append(View(f"{len(views):04d}.png", pixels, np.asarray(visible, np.float64)))
        return Scene(self.board, cover, path, values, poses, tuple(views))

    @property
    def setup(self) -> Setup:
        """The session's description."""
        assert self.camera.intrinsics
        return Setup(self.board, self.camera, self.camera.intrinsics, self.cover(self.start))

    def cover(self, estimated: Mapping[str, Number]) -> Cover:
        known = {name: Number(value, exact=True) for name, value in self.known.items()}
        return Cover(self.shape, {**known, **estimated})


DOME = Housing(
    shape="dome",
    board=Board(6, 7, 0.04),
    camera=camera(2048, 1536, 1024.0),
    known={
        "inner_radius": 0.0501,
        "thickness": 0.007,
        "refractive_index": GLASS,
        "outside_index": WATER,
    },
    true={"centre.x": 0.0, "centre.y": 0.0, "centre.z": -0.03},
    start={f"centre.{axis}": Number(0.0, 0.03) for axis in "xyz"},
    poses=np.array(
        [
            [-0.34, 0.21, 2.88, -0.185, -0.057, 0.68],
            [0.36, -0.06, -2.59, -0.285, -0.054, 0.68],
            [-0.30, 1.04, 2.78, 0.550, 0.045, 0.94],
            [0.05, 0.17, -3.03, -0.041, -0.143, 0.50],
            [0.21, 0.20, 2.82, -0.070, -0.203, 0.95],
            [0.20, 0.25, 3.08, -0.064, -0.351, 1.50],
            [0.20, 0.25, 3.08, -0.054, -0.053, 0.51],
            [0.32, -0.08, -2.51, -0.040, 0.055, 0.41],
        ]
    ),
)
FLAT = Housing(
    shape="flat",
    board=Board(6, 7, 1.0),
    camera=camera(1280, 1024, 864.91),
    known={"thickness": 0.014, "refractive_index": GLASS, "outside_index": WATER},
    # The port's normal is (0.1, 0.1, 1), normalised, and its distance along that 20 mm.
    true={"distance": 0.02 * 1.02**0.5, "tilt.x": -0.0993412, "tilt.y": 0.0993412},
    start={
        "distance": Number(0.04, 0.02),
        "tilt.x": Number(0.0, 0.1),
        "tilt.y": Number(0.0, 0.1),
    },
    poses=np.array(
        [
            [1.78, 0.01, -2.58, -4.0, -1.0, 13.1],
            [-0.36, 0.36, 1.54, -0.8, 0.8, 9.6],
            [-0.59, -0.88, -2.88, -0.3, -1.4, 12.6],
            [-0.58, -0.29, -3.06, 4.8, -2.7, 21.7],
            [0.00, 0.00, 3.14, -2.4, -1.0, 10.8],
            [-0.23, -0.03, 2.91, -6.0, -3.5, 21.3],
            [0.38, -0.26, 3.10, 1.1, -0.5, 12.9],
            [0.08, -0.20, -3.11, -2.9, -1.0, 12.8],
            [-0.27, 0.27, 1.55, -1.0, 0.1, 9.7],
            [0.00, 0.00, 3.14, 0.3, -1.0, 10.8],
        ]
    ),
)


@dataclass(frozen=True)
class Results:
    """The estimates of one housing's sessions."""

    errors: Array
    """(seeds, numbers) m and rad, the estimates less the truth."""
    sigmas: Array
    """(seeds, numbers) m and rad."""
    even_sigmas: Array
    """(seeds, numbers) m and rad, those of fits that know that the glass is even."""


@pytest.fixture(scope="module", params=(DOME, FLAT), ids=lambda housing: housing.shape)
def results(request: pytest.FixtureRequest) -> Results:
    housing: Housing = request.param
    scene = housing.scene
    setup = housing.setup
    even = replace(setup, cover=setup.cover.with_surface(EVEN))
    estimates: list[Array] = []
    even_estimates: list[Array] = []
    for seed in SEEDS:
        noisy = with_noise(scene, seed)
        estimates.append(numbers(calibrated(noisy, setup, Settings()), housing))
        even_estimates.append(numbers(calibrated(noisy, even, Settings()), housing))
    values, sigmas = np.moveaxis(np.array(estimates), 1, 0)
    return Results(
        errors=values - np.array(list(housing.true.values())),
        sigmas=sigmas,
        even_sigmas=np.array(even_estimates)[:, 1],
    )


@pytest.mark.slow
def test_errors_are_as_large_as_their_sigmas_say(results: Results) -> None:
    deviations = np.abs(results.errors / results.sigmas)
    assert np.mean(deviations <= MAX_DEVIATION) >= 0.95


@pytest.mark.slow
def test_a_sigma_is_no_smaller_than_if_the_glass_is_known_to_be_even(results: Results) -> None:
    # The two fits are the same to rounding where the fit finds the glass even.
    assert np.all(results.sigmas >= (1 - 1e-6) * results.even_sigmas)


def with_noise(scene: Scene, seed: int) -> Scene:
    """Return the scene with noise in its pictures."""
    rng = np.random.default_rng(seed)
    views = tuple(
        replace(view, corners=view.corners + rng.normal(0, NOISE, view.corners.shape))
        for view in scene.views
    )
    return replace(scene, views=views)


def numbers(calibration: Calibration, housing: Housing) -> Array:
    """Return the (2, numbers) values and sigmas of the estimated numbers, m and rad."""
    estimates = [calibration.cover.parameters[name] for name in housing.true]
    values = [number.value for number in estimates]
    sigmas = [number.sigma for number in estimates]
    return np.array([values, sigmas])

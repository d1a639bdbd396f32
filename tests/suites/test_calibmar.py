"""The housing tests of Calibmar: their corners, poses and noise, our estimates, their tolerances.

The numbers are read from their file, whose arrays are written in braces.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.corners.view import View
from calib.fit_record.request import Settings
from fixtures.calibrated import calibrated
from fixtures.synthetic import Scene
from tests.fitting.test_housings import DOME, FLAT, NOISE, numbers
from tests.suites.fetch import CALIBMAR

Array = NDArray[np.float64]

PATH = CALIBMAR.folder / "tests" / "calibrators" / "housing_calibrator_test.cpp"
DOME_TOLERANCE = 0.001
"""m, of the middle of the dome."""
NORMAL_TOLERANCE = 0.0002
"""The tolerance of each coordinate of the window's unit normal."""
DISTANCE_TOLERANCE = 0.01
"""m, of the window's distance: their tolerance, of which they say that it is not estimated well."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not PATH.exists(), reason=CALIBMAR.skipped),
]


def array(name: str, width: int) -> Array:
    """Return the (N, width) numbers of one of their arrays."""
    text = PATH.read_text()
    start = re.search(rf"{name}\s*=\s*\{{", text)
    assert start, f"{PATH} has no {name}"
    body = text[start.end() : text.index("};", start.end())]
    return np.array(re.findall(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?", body), float).reshape(-1, width)


def middle() -> Array:
    """Return the (3,) middle of their board, in squares."""
    points = array("points3D", 3)
    assert len(points) == 42
    return np.asarray(points.mean(0))


def test_dome() -> None:
    """Their corners, of 8 pictures of 42."""
    pictures = array("point2DSetsDome", 2).reshape(-1, 42, 2)
    assert len(pictures) == 8
    made = with_corners(DOME.scene, pictures)
    values, sigmas = numbers(calibrated(made, DOME.setup, Settings()), DOME)
    assert np.abs(values - [0, 0, -0.03]).max() < DOME_TOLERANCE, (values, sigmas)


def test_flat_port() -> None:
    """Their poses, and noise of their kind: 0.125 px of a draw, in any direction."""
    poses = array("test_poses", 7)
    assert len(poses) == 10
    turns = Rotation.from_quat(poses[:, :4])
    places = poses[:, 4:] + turns.apply(middle())
    exact = replace(FLAT, poses=np.column_stack([turns.as_rotvec(), places])).scene
    rng = np.random.default_rng(0)
    clean = np.stack([view.corners for view in exact.views])
    directions = rng.normal(size=clean.shape)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    made = with_corners(exact, clean + directions * rng.normal(0, NOISE, (*clean.shape[:2], 1)))
    fitted = calibrated(made, FLAT.setup, Settings()).cover.parameters
    turn = Rotation.from_rotvec([fitted["tilt.x"].value, fitted["tilt.y"].value, 0])
    true = np.array([0.1, 0.1, 1]) / np.linalg.norm([0.1, 0.1, 1])
    assert np.abs(turn.apply([0, 0, 1]) - true).max() < NORMAL_TOLERANCE
    assert abs(fitted["distance"].value * turn.apply([0, 0, 1])[2] - 0.02) < DISTANCE_TOLERANCE


def with_corners(made: Scene, pictures: Array) -> Scene:
    """Return the scene with (V, 42, 2) px of corners; NaN where a picture shows none."""
    views = tuple(
        View(f"{index:04d}.png", corners, np.isfinite(corners).all(-1).astype(float))
        for index, corners in enumerate(pictures)
    )
    return replace(made, views=views)

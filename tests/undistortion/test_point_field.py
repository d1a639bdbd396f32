"""Many rays and points through the field, against tracing each."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calib import calibration as room
from calib.calibration import Calibration
from calib.session.cover import Cover
from calib.session.schema import Number
from fixtures.known import known, lens_alone
from fixtures.synthetic import scene

SIZE = 820, 616
SURE = 1e-3
"""px: what is promised."""
FOCAL = 640.0
"""px, about: a direction's error in px is its error in radians times this."""


def cone() -> Calibration:
    return known(scene(1, views=1, grid=(8, 8), amplitude=3e-5), *SIZE)


def dome() -> Calibration:
    """Return a small dome whose centre is 6 mm behind the pinhole, so that rays bend."""
    numbers = {
        "inner_radius": 0.02,
        "centre.x": 1e-3,
        "centre.y": -5e-4,
        "centre.z": -6e-3,
        "thickness": 3e-3,
    }
    cover = Cover(
        "dome",
        {
            name: Number(value)
            for name, value in (numbers | {"refractive_index": 1.5, "outside_index": 1.34}).items()
        },
    )
    return known(
        scene(2, views=1, cover=cover, patch=((-0.5, -0.5), (0.5, 0.5)), amplitude=1e-9), *SIZE
    )


def narrow() -> Calibration:
    """A lens that turns back on itself within the picture: beyond, no ray is known."""
    return lens_alone(scene(1, views=1), *SIZE, 400.0, 400.0, 409.5, 307.5, -0.35)


EACH = pytest.mark.parametrize(
    "made", [cone, dome, narrow], ids=["cone", "dome", "a lens that folds"]
)


def both(
    monkeypatch: pytest.MonkeyPatch, rays_of: Callable[[], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Through the field, and traced."""
    monkeypatch.setattr(room, "MIN_FIELD_POINTS", 0)
    through = rays_of()
    monkeypatch.setattr(room, "MIN_FIELD_POINTS", 10**9)
    return through, rays_of()


@EACH
def test_rays_are_those_that_are_traced(
    made: Callable[[], Calibration], monkeypatch: pytest.MonkeyPatch
) -> None:
    calibration = made()
    rng = np.random.default_rng(0)
    pixels = rng.uniform(
        [-200, -200], [SIZE[0] + 200, SIZE[1] + 200], (3000, 2)
    )  # some beyond the field
    pixels[0] = np.nan
    through, traced = both(monkeypatch, lambda: np.concatenate(calibration.rays(pixels), 1))
    invalid = np.isnan(traced).any(1)
    assert invalid[0]
    assert np.array_equal(np.isnan(through).any(1), invalid)
    assert np.abs(through - traced)[~invalid, 3:].max() < SURE / FOCAL
    assert np.abs(np.linalg.norm(through[~invalid, 3:], axis=1) - 1).max() < 1e-12
    assert (
        np.abs(through - traced)[~invalid, :3].max() < 1e-6
    )  # m along the ray, or a thousandth of a millimetre beside it


@EACH
def test_points_are_seen_where_tracing_sees_them(
    made: Callable[[], Calibration], monkeypatch: pytest.MonkeyPatch
) -> None:
    calibration = made()
    rng = np.random.default_rng(1)
    depth = rng.uniform(0.1, 3.0, 3000)
    points = np.column_stack([rng.uniform(-0.9, 0.9, (3000, 2)) * depth[:, None], depth])
    points[:4] = np.array([[np.nan, 0, 1], [0, 0, -1], [0, 0, 0.001], [0.1, np.inf, 1]])
    through, traced = both(monkeypatch, lambda: calibration.project(points))
    invalid = np.isnan(traced).any(1)
    assert np.array_equal(np.isnan(through).any(1), invalid)
    assert np.abs(through - traced)[~invalid].max() < SURE


def test_a_camera_that_sees_nothing_is_refused_for_any_number_of_points(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The window of this camera stands behind it."""
    made = scene(3, views=1)
    numbers = {
        "distance": 0.01,
        "tilt.x": 3.0,
        "tilt.y": 0.0,
        "thickness": 3e-3,
        "refractive_index": 1.5,
        "outside_index": 1.0,
    }
    calibration = known(made, *SIZE)
    blind = replace(
        calibration,
        relief=None,
        cover=Cover("flat", {name: Number(value) for name, value in numbers.items()}),
    )
    pixels = np.random.default_rng(0).uniform([0, 0], SIZE, (50, 2))
    through, traced = both(monkeypatch, lambda: np.concatenate(blind.rays(pixels), 1))
    assert np.isnan(through).all()
    assert np.isnan(traced).all()

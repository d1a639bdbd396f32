"""The prior of the shared parameters, against their covariance built by hand."""

import numpy as np
import pytest
import torch

from calib.estimation.parameters import Parameters
from calib.estimation.priors import Priors
from calib.estimation.surface_prior import (
    Smoothness,
    expected_amplitudes,
    figure_covariance,
    relief_basis,
)
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.glass import Glass
from fixtures.synthetic import scene

SMOOTH = Smoothness(2e-5, 0.4)
NAMES = ("cover.thickness", "camera.fx", "camera.cy", "camera.fy")
SIGMAS = np.array([2e-4, 3.0, 0.5, 7.0])
CORRELATIONS = {
    ("camera.fy", "camera.fx"): 0.99,
    ("camera.cy", "camera.fx"): -0.3,
    ("camera.fy", "camera.cy"): -0.2,
}


@pytest.fixture(scope="module")
def model() -> tuple[Path, Values]:
    made = scene(1, views=1, grid=(3, 4))
    return made.path, made.values


def covariance_of(parameters: Parameters) -> np.ndarray:
    """Return the covariance of the free parameters, over their scales."""
    at = {name: i for i, name in enumerate(NAMES)}
    correlation = np.eye(len(NAMES))
    for (first, second), value in CORRELATIONS.items():
        correlation[at[first], at[second]] = correlation[at[second], at[first]] = value
    order = [at[param.name] for param in parameters.free]
    spread = np.array([SIGMAS[at[param.name]] / param.scale for param in parameters.free])
    return correlation[np.ix_(order, order)] * np.outer(spread, spread)


@pytest.mark.parametrize(
    "names", [NAMES, NAMES[:2], NAMES[1:], ("camera.fy", "camera.fx")], ids=len
)
def test_the_precision_is_the_inverse_of_the_covariance(
    model: tuple[Path, Values], names: tuple[str, ...]
) -> None:
    """Pairs of which one is held say nothing of the other."""
    sigmas = {
        name: float(sigma) for name, sigma in zip(NAMES, SIGMAS, strict=True) if name in names
    }
    parameters = Parameters.of(*model, Priors(sigmas, CORRELATIONS))
    covariance = covariance_of(parameters)
    free = parameters.amplitudes
    precision, root = parameters.prior_precision(SMOOTH), parameters.prior_root(SMOOTH)
    assert {param.name for param in parameters.free} == set(names)
    assert (
        np.abs(precision[free:, free:] @ covariance - np.eye(len(names))).max() < 1e-10
    )  # of a condition number of 1e4
    assert not precision[free:, :free].any()
    assert np.allclose(root[free:, free:] @ root[free:, free:].T, covariance, rtol=1e-12)
    relief = root[:free, :free] @ root[:free, :free].T @ precision[:free, :free]
    assert np.abs(relief - np.eye(free)).max() < 1e-3, (
        "heights of 1e-4 m with 1e-9 m of their own lose ten digits"
    )


def known_glass(path: Path) -> Glass:
    """Return the glass of the path's own patch, correlated with two numbers, one of which no fit
    estimates.
    """
    assert path.relief
    spread = np.diag([3e-6, 2e-6, 1e-6]) ** 2 + 1e-13
    cross_covariance = np.stack(
        [0.5 * SIGMAS[1] * np.array([1e-6, -1e-6, 0.0]), np.full(3, 1e-9)], 1
    )
    return Glass(
        path.relief.low,
        path.relief.high,
        1,
        np.array([1e-5, 0.0, 2e-6]),
        spread,
        ("camera.fx", "cover.inner_radius"),
        cross_covariance,
    )


def test_a_known_figure_is_correlated_with_the_numbers(model: tuple[Path, Values]) -> None:
    """Oracle: heights drawn from texture, what is finer than the figure, and the figure, whose
    coefficients go with the focal length.
    """
    path, _ = model
    assert path.relief
    glass = known_glass(path)
    sigmas = {name: float(sigma) for name, sigma in zip(NAMES, SIGMAS, strict=True)}
    parameters = Parameters.of(*model, Priors(sigmas, CORRELATIONS, glass=glass))
    heights, free = parameters.amplitudes, [param.name for param in parameters.free]
    sides = [np.linspace(-1, 1, count) for count in path.relief.grid]
    y, x = np.stack(np.meshgrid(*sides, indexing="ij")).reshape(2, -1)
    waves = np.stack([np.ones_like(x), x, y], 1)
    root = parameters.joint_root(SMOOTH, glass)
    covariance = root @ root.T
    height_covariance = (
        SMOOTH.covariance(path.relief)
        - figure_covariance(path.relief.grid)
        + figure_covariance(path.relief.grid, 1)
        + waves @ glass.covariance @ waves.T
    )
    assert covariance[:heights, :heights] == pytest.approx(height_covariance, rel=1e-9)
    place = free.index("camera.fx")
    cross_block = waves @ glass.cross_covariance[:, 0] / parameters.free[place].scale
    assert covariance[:heights, heights + place] == pytest.approx(cross_block, rel=1e-9, abs=1e-20)
    assert not np.delete(covariance[:heights, heights:], place, 1).any()
    assert covariance[heights:, heights:] == pytest.approx(covariance_of(parameters), rel=1e-9)
    precision, prior_root = parameters.prior_precision(SMOOTH), parameters.prior_root(SMOOTH)
    assert np.abs(prior_root.T @ precision @ prior_root - np.eye(len(prior_root))).max() < 1e-3, (
        "as above"
    )
    amplitudes = expected_amplitudes(path.relief, glass).ravel()
    assert relief_basis(path.relief) @ amplitudes == pytest.approx(waves @ glass.mean, rel=1e-9)


def test_parameters_of_effects_are_independent_of_the_glass(model: tuple[Path, Values]) -> None:
    """The parameters of effects are independent, entry by entry, wherever they stand."""
    path, values = model
    sigmas = {name: float(sigma) for name, sigma in zip(NAMES, SIGMAS, strict=True)}
    priors = Priors(sigmas, CORRELATIONS).with_sigmas({"more": torch.tensor([1.0, 2.0])})
    alone = Parameters.of(path, values, Priors(sigmas, CORRELATIONS))
    extra = Param("more", "", 0.5, (2,))
    parameters = Parameters({**values, "more": torch.zeros(2)}, None, (extra, *alone.free), priors)
    precision = parameters.prior_precision(None)
    assert np.diag(precision)[:2] == pytest.approx([0.25, 0.0625])
    assert not precision[:2, 2:].any()
    assert np.allclose(precision[2:, 2:] @ covariance_of(alone), np.eye(4), atol=1e-10)


def test_entries_may_be_correlated_among_themselves(model: tuple[Path, Values]) -> None:
    """The entries have the given covariance, and are independent of all other parameters."""
    path, values = model
    sigmas = {name: float(sigma) for name, sigma in zip(NAMES, SIGMAS, strict=True)}
    root = np.array([[2.0, 0.0, 0.0], [1.0, 3.0, 0.0], [0.5, -1.0, 0.7]])
    priors = Priors({**sigmas, "more": 1.0}, CORRELATIONS, {"more": root})
    alone = Parameters.of(path, values, Priors(sigmas, CORRELATIONS))
    parameters = Parameters(
        {**values, "more": torch.zeros(3)},
        None,
        (Param("more", "", 0.5, (3,)), *alone.free),
        priors,
    )
    precision = parameters.prior_precision(None)
    assert np.allclose(precision[:3, :3] @ (root @ root.T) / 0.5**2, np.eye(3), rtol=0, atol=1e-12)
    assert not precision[:3, 3:].any()
    assert np.allclose(
        precision[3:, 3:] @ covariance_of(alone), np.eye(len(NAMES)), rtol=0, atol=1e-9
    )
    assert np.allclose(Priors(roots={"more": root}).with_sigmas({"other": 1.0}).roots["more"], root)

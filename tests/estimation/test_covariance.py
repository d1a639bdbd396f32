"""The operations on covariances."""

import numpy as np
import pytest
import torch

from calib.estimation.covariance import covariance_root, invert_precision, regression


def test_the_inverse_is_exact_for_parameters_of_any_unit() -> None:
    """The units reach from nanometres to thousands of pixels; integers give the exact inverse."""
    rng = np.random.default_rng(0)
    lower = np.tril(rng.integers(-1, 2, (12, 12)), -1) + np.eye(12)
    inverse = np.round(np.linalg.inv(lower))
    assert (lower @ inverse == np.eye(12)).all()
    exact = inverse.T @ inverse
    scale = np.logspace(-9, 4, 12)
    precision = lower @ lower.T / np.outer(scale, scale)
    covariance = invert_precision(torch.from_numpy(precision)).numpy()
    sigmas = scale * np.sqrt(exact.diagonal())
    error = (covariance - exact * np.outer(scale, scale)) / np.outer(sigmas, sigmas)
    assert np.abs(error).max() < 1e-9  # the condition number is 1e5
    assert (covariance == covariance.T).all(), "symmetric to the last bit"


def test_a_direction_that_only_rounding_determines_stays_open() -> None:
    """Two parameters do the same. Their sum is determined, their difference is not, and no variance
    is negative.
    """
    precision = torch.tensor(
        [[4.0, 4e6, 0.0], [4e6, 4e12, 0.0], [0.0, 0.0, 9.0]], dtype=torch.float64
    )
    precision[0, 0] *= 1 - 1e-15  # as rounding leaves it
    covariance = invert_precision(precision)
    assert (covariance == covariance.mT).all()
    assert covariance[2, 2] == pytest.approx(1 / 9)
    assert covariance[0, 0] > 1e10
    assert float(torch.linalg.eigvalsh(covariance)[0]) > -1e-12 * float(covariance[0, 0])


def test_the_root_of_a_covariance_keeps_small_variances() -> None:
    """A relief's variances stand beside a focal length's; a fit with this as its prior once ended
    16 sigma from the truth.
    """
    rng = np.random.default_rng(5)
    spread = np.logspace(-6, 1, 30)
    mixed = rng.normal(size=(30, 40))
    correlation = mixed @ mixed.T / 40
    covariance = spread[:, None] * correlation * spread
    root = covariance_root(covariance)
    error = (root @ root.T - covariance) / np.outer(spread, spread)
    assert np.abs(error).max() < 1e-13
    held = covariance_root(np.diag([4.0, 0.0]))
    assert (held @ held.T == np.diag([4.0, 0.0])).all()


def test_the_regression_leaves_no_correlation_with_its_parameters() -> None:
    """The units differ by ten decades, and one parameter of the two is held."""
    rng = np.random.default_rng(2)
    scale = np.array([1e-7, 1.0, 1e3, 0.0])
    mixed = rng.normal(size=(4, 9))
    covariance = scale[:, None] * (mixed @ mixed.T) * scale
    by_some = regression(covariance, np.array([0, 3]))
    remainder = covariance - by_some @ covariance[[0, 3]]
    assert by_some[0] == pytest.approx([1.0, 0.0])
    assert np.abs(remainder[:, 0]).max() < 1e-9 * np.abs(covariance[:, 0]).max()
    assert by_some[1, 0] == pytest.approx(covariance[1, 0] / covariance[0, 0], rel=1e-9)

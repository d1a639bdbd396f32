"""The information of views about a camera, from its posterior, and its conflict with a prior."""

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.estimation.likelihood_information import LikelihoodInformation, prior_conflict

Array = NDArray[np.float64]
SIZE = 6
CAMERAS = 400


def a_prior(rng: np.random.Generator) -> tuple[Array, Array]:
    root = np.asarray(np.tril(rng.normal(size=(SIZE, SIZE))) + 2 * np.eye(SIZE), np.float64)
    return rng.normal(size=SIZE), root @ root.T


def test_the_likelihood_between_prior_and_posterior_is_recovered() -> None:
    """The oracle multiplies a prior by a likelihood that leaves two directions open."""
    rng = np.random.default_rng(1)
    mean, prior = a_prior(rng)
    rows = np.asarray(rng.normal(size=(SIZE - 2, SIZE)))
    measured = rng.normal(size=SIZE - 2)
    covariance = np.linalg.inv(rows.T @ rows + np.linalg.inv(prior))
    posterior = covariance @ (rows.T @ measured + np.linalg.solve(prior, mean))
    likelihood = LikelihoodInformation.between(posterior, covariance, mean, prior)
    assert likelihood.information == pytest.approx(rows.T @ rows, abs=1e-8)
    assert likelihood.score == pytest.approx(rows.T @ measured, abs=1e-8)


def test_a_posterior_equal_to_the_prior_carries_no_information() -> None:
    mean, prior = a_prior(np.random.default_rng(2))
    likelihood = LikelihoodInformation.between(mean, prior, mean, prior)
    assert likelihood.information == pytest.approx(np.zeros((SIZE, SIZE)), abs=1e-9)
    assert prior_conflict(likelihood, mean, prior).p_value == 1.0


def surprises(shift: float) -> np.ndarray:
    """Draw CAMERAS from a prior and move them along its first axis by so many sigmas. Return (2,
    CAMERAS): the squares per direction, and the p-values.
    """
    rng = np.random.default_rng(3)
    mean, prior = a_prior(rng)
    root = np.linalg.cholesky(prior)
    results = []
    for _ in range(CAMERAS):
        true = mean + root @ (rng.standard_normal(SIZE) + shift * np.eye(SIZE)[0])
        rows = rng.normal(size=(4, SIZE))  # fewer than there are numbers
        likelihood = LikelihoodInformation(
            rows.T @ rows, rows.T @ (rows @ true + rng.standard_normal(4))
        )
        item = prior_conflict(likelihood, mean, prior)
        results.append((item.square / item.directions, item.p_value))
    return np.array(results).T


def test_a_camera_of_the_fleet_does_not_conflict_with_the_prior() -> None:
    """The square per direction is one, within four of its standard errors (2 / directions /
    cameras); and p-values are even.
    """
    squares, p_values = surprises(0.0)
    assert squares.mean() == pytest.approx(1.0, abs=4 * (2 / 4 / CAMERAS) ** 0.5)
    assert (p_values < 0.1).mean() == pytest.approx(0.1, abs=4 * (0.09 / CAMERAS) ** 0.5)


def test_another_camera_conflicts_with_the_prior() -> None:
    _, p_values = surprises(12.0)
    assert np.median(p_values) < 1e-3


def test_the_largest_deviation_names_the_wrong_number() -> None:
    mean, prior = np.zeros(SIZE), np.eye(SIZE)
    likelihood = LikelihoodInformation(
        np.diag([100.0] * 5 + [0.0]), 100.0 * np.array([0, 0, 5.0, 0, 0, 0])
    )
    pulls = likelihood.deviations(mean, prior)
    assert int(np.argmax(np.abs(pulls))) == 2
    assert pulls[2] == pytest.approx(5.0, rel=0.02)
    assert pulls[5] == 0.0  # of which nothing is told

"""The expectation of the next camera is as certain as it should be, whatever each camera's views
determine.
"""

import numpy as np
import pytest

from calib.estimation.likelihood_information import LikelihoodInformation, prior_conflict
from calib.fleet.population import Population, population

SIZE = 5
FLEETS, NEXT = 12, 20
SPREAD = np.array([0.03, 0.1, 0.2, 0.05, 0.1])
"""The spread of the cameras, over the tolerances."""


def fleet(seed: int, cameras: int, noise: float) -> tuple[Population, np.ndarray]:
    """Return the expectation, and the (NEXT, SIZE) numbers of the next cameras. The views of each
    camera determine its numbers to `noise` times a tolerance, and one of them not at all.
    """
    rng = np.random.default_rng([seed, cameras])
    mean = 0.5 * rng.standard_normal(SIZE)
    likelihoods = []
    for _ in range(cameras):
        rows = rng.normal(size=(SIZE - 1, SIZE)) / noise
        true = mean + SPREAD * rng.standard_normal(SIZE)
        likelihoods.append(
            LikelihoodInformation(
                rows.T @ rows, rows.T @ (rows @ true + rng.standard_normal(SIZE - 1))
            )
        )
    return population(
        likelihoods, np.zeros(SIZE), np.eye(SIZE)
    ), mean + SPREAD * rng.standard_normal((NEXT, SIZE))


def squares(cameras: int, noise: float) -> float:
    """Squared error over what is predicted, per number."""
    results = []
    for seed in range(FLEETS):
        expected, later = fleet(seed, cameras, noise)
        deviation = later - expected.mean
        results.append(
            float(
                (deviation * np.linalg.solve(expected.covariance, deviation.T).T).sum(1).mean()
                / SIZE
            )
        )
    return float(np.mean(results))


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.02, 0.3])
def test_the_next_camera_deviates_as_predicted(noise: float) -> None:
    """The square of many cameras is one; 12 fleets of 5 numbers leave it uncertain by a tenth."""
    assert 0.7 < squares(40, noise) < 1.2


@pytest.mark.parametrize("noise", [0.02, 0.3])
def test_few_cameras_give_a_cautious_expectation(noise: float) -> None:
    assert squares(4, noise) < 1.1


def test_an_uncertain_camera_does_not_widen_the_fleet() -> None:
    """Control: estimates scatter by the noise and the spread together, which is what a plain
    covariance of them would say.
    """
    expected, _ = fleet(0, 40, 1.0)
    assert (np.sqrt(expected.covariance.diagonal()) < 0.6).all()


@pytest.mark.parametrize("cameras", [4, 10, pytest.param(40, marks=pytest.mark.slow)])
def test_cameras_of_the_fleet_rarely_conflict_with_its_expectation(cameras: int) -> None:
    """One of a hundred would be; of 240, more than eight come once in a thousand tries."""
    alarms = 0
    for seed in range(FLEETS):
        expected, later = fleet(seed, cameras, 0.1)
        for true in later:
            likelihood = LikelihoodInformation(1e4 * np.eye(SIZE), 1e4 * true)
            alarms += prior_conflict(likelihood, expected.mean, expected.covariance).p_value < 0.01
    assert alarms <= 8


def test_more_cameras_give_a_narrower_expectation() -> None:
    of_few = np.sqrt(fleet(1, 4, 0.1)[0].covariance.diagonal())
    many = np.sqrt(fleet(1, 40, 0.1)[0].covariance.diagonal())
    assert (many < of_few).all()


def test_numbers_that_no_camera_determines_keep_their_tolerance() -> None:
    blind = [LikelihoodInformation(np.diag([1e4] * 4 + [0.0]), np.zeros(SIZE))] * 10
    expected = population(blind, np.zeros(SIZE), np.eye(SIZE))
    assert expected.covariance[4, 4] == pytest.approx(1.0, rel=0.1)
    assert expected.covariance[0, 0] < 0.01


def test_the_sampler_is_deterministic() -> None:
    item = fleet(2, 6, 0.1)[0]
    two = fleet(2, 6, 0.1)[0]
    assert (item.mean == two.mean).all()
    assert (item.covariance == two.covariance).all()

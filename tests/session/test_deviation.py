"""Deviations of estimates from expected values, for numbers that are drawn from their tolerance."""

import numpy as np
import pytest

from calib.session.deviation import independent_deviation, normalised_deviation


@pytest.mark.parametrize("noise", [0.1, 1.0, 10.0])
def test_a_deviation_has_a_variance_of_one(noise: float) -> None:
    """Each number is measured once. The measurement alone is independent of the expected value, the
    posterior mean is not; their deviations are the same.
    """
    rng = np.random.default_rng(0)
    tolerance = 2.0
    draws = 4000
    numbers = rng.normal(0, tolerance, draws)
    measured = numbers + rng.normal(0, noise, draws)
    variance = 1 / (tolerance**-2 + noise**-2)
    posterior_means = measured * variance / noise**2
    by_posterior = normalised_deviation(posterior_means, tolerance, variance**0.5)
    by_measurement = [independent_deviation(value, tolerance, noise) for value in measured]
    scatter = (2 / draws) ** 0.5  # of the mean of squares
    assert np.mean(np.square(by_measurement)) == pytest.approx(1.0, abs=3 * scatter)
    assert by_posterior == pytest.approx(by_measurement)


def test_a_number_that_the_views_do_not_determine_has_no_deviation() -> None:
    assert normalised_deviation(5.0, 1.0, 1.0) == 0.0
    assert normalised_deviation(5.0, 1.0, 0.99, min_gain=0.05) == 0.0

"""The distance of an estimate from what was expected, in the standard deviations that the distance
has if the expectation holds. An estimate that used the expectation as its prior lies nearer to it
than an independent one, and so does its standard deviation: the deviation is the same.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def normalised_deviation(
    distance: ArrayLike,
    tolerance: ArrayLike,
    sigma: ArrayLike,
    min_gain: float = 0.0,
    min_spread: float = 0.0,
) -> Array:
    """Return the deviation of an estimate that used the expected value as the mean of its prior.

    If the true value is drawn from the prior, the variance of estimate - mean is the variance of
    the prior minus that of the posterior.

    Args:
        distance: (...) estimate minus expected value.
        tolerance: (...) standard deviation of the prior.
        sigma: (...) standard deviation of the estimate.
        min_gain: the smallest part of the prior's variance that the views must have removed. The
            deviation of a number that they do not determine is 0.
        min_spread: the smallest standard deviation of estimate - mean, as a fraction of the
            tolerance. Where the views tell little, it is the difference of two nearly equal
            variances.
    """
    prior_variance = np.square(np.asarray(tolerance, np.float64))
    variance = prior_variance - np.square(sigma)
    informed = variance > min_gain * prior_variance
    variance = np.maximum(variance, min_spread**2 * prior_variance)
    return np.asarray(
        np.where(informed, distance, 0.0) / np.sqrt(np.where(informed, variance, 1.0))
    )


def independent_deviation(distance: float, tolerance: float, sigma: float) -> float:
    """Return the deviation of an estimate that does not depend on the expected value: its variance
    and that of the expected value add.
    """
    return distance / float(np.hypot(tolerance, sigma))

"""The information of one camera's views about its numbers, and its conflict with a prior: how far
the views pull the numbers away from their expected values, in the directions that the views
determine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from calib.session.deviation import normalised_deviation

Array = NDArray[np.float64]

MIN_GAIN = 0.05
"""The smallest information along a direction, as a fraction of the prior's precision, that counts.
A smaller apparent information comes from the point at which the fit was linearised.
"""


@dataclass(frozen=True, slots=True, eq=False)
class LikelihoodInformation:
    """The normal likelihood of one camera's K numbers, given its views, by information and score.
    The information may be zero in some directions.
    """

    information: Array
    """(K, K) L: the logarithm of the likelihood of x is s x - x L x / 2, with s the score."""
    score: Array
    """(K,) s"""

    @staticmethod
    def between(
        mean: Array, covariance: Array, prior_mean: Array, prior: Array
    ) -> LikelihoodInformation:
        """Return the likelihood that turned a prior into a posterior.

        Args:
            mean, covariance: (K,) and (K, K) of the posterior.
            prior_mean, prior: (K,) and (K, K) mean and covariance of the prior.
        """
        root = np.linalg.cholesky(prior)
        whitened = np.linalg.solve(root, np.linalg.solve(root, covariance).T)
        ratio, axes = np.linalg.eigh((whitened + whitened.T) / 2)
        # Views cannot remove information: a ratio above one comes from rounding, or from another
        # point of linearisation.
        ratio = np.clip(ratio, np.finfo(float).eps, 1.0)
        # The sum of the columns' squares is the prior's precision.
        axes = np.linalg.solve(root.T, axes)
        gain = np.where(1 / ratio - 1 > MIN_GAIN, 1 / ratio - 1, 0.0)
        information = (axes * gain) @ axes.T
        shift = np.where(gain > 0, axes.T @ (mean - prior_mean) / ratio, 0.0)
        return LikelihoodInformation(information, information @ prior_mean + axes @ shift)

    def deviations(self, mean: Array, covariance: Array) -> Array:
        """Return the (K,) deviations of the estimates from their expected values, for the (K,) mean
        and (K, K) covariance of a prior, in the standard deviations that they have if the prior
        holds; 0 for a number that the views do not determine.
        """
        posterior = np.linalg.inv(self.information + np.linalg.inv(covariance))
        shift = posterior @ (self.score - self.information @ mean)
        tolerance = np.sqrt(covariance.diagonal())
        return normalised_deviation(shift, tolerance, np.sqrt(posterior.diagonal()), MIN_GAIN)


@dataclass(frozen=True, slots=True)
class PriorConflict:
    """The distance between a camera and its prior, in the directions that its views determine."""

    square: float
    """The squared distance, in standard deviations."""
    directions: int
    """The number of these directions."""
    p_value: float
    """The probability that a camera of the fleet is as far or farther from the prior."""


def prior_conflict(
    likelihood: LikelihoodInformation, mean: Array, covariance: Array
) -> PriorConflict:
    """Return the conflict of a camera with a prior, (K,) and (K, K), to which it did not
    contribute.
    """
    root = np.linalg.cholesky(covariance)
    gain, axes = np.linalg.eigh(root.T @ likelihood.information @ root)
    pull = axes.T @ (root.T @ (likelihood.score - likelihood.information @ mean))
    informed = gain > MIN_GAIN
    directions = int(informed.sum())
    if not directions:
        return PriorConflict(0.0, 0, 1.0)
    variance = 1 / (1 + gain[informed])  # of the posterior; the prior's is 1
    deviations = normalised_deviation(variance * pull[informed], 1.0, np.sqrt(variance))
    square = float((deviations**2).sum())
    return PriorConflict(square, directions, float(chdtrc(directions, square)))

"""Whether a camera is as its prior expects: how far its views pull its numbers away, where they
tell them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

Array = NDArray[np.float64]

TOLD = 0.05
"""Of the prior's precision: of a direction of which views tell less, what they seem to say is what
the fit was linearised by.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """What one camera's views say of its K numbers: a normal likelihood, by information and score,
    which may be zero in some directions.
    """

    information: Array
    """(K, K) L, and `score` (K,) s: the logarithm of the likelihood of x is s x - x L x / 2."""
    score: Array

    @staticmethod
    def between(mean: Array, covariance: Array, prior_mean: Array, prior: Array) -> Told:
        """What turned a prior into a posterior.

        Args:
            mean: (K,) of the posterior, and its (K, K) covariance; `prior_mean`, `prior`: the same
                of the prior.
        """
        root = np.linalg.cholesky(prior)
        whitened = np.linalg.solve(root, np.linalg.solve(root, covariance).T)
        kept, axes = np.linalg.eigh((whitened + whitened.T) / 2)
        kept = np.clip(
            kept, np.finfo(float).eps, 1.0
        )  # rounding, or a linearisation elsewhere: views tell nothing less than nothing
        axes = np.linalg.solve(
            root.T, axes
        )  # columns, whose squares sum up to the prior's precision
        gained = np.where(1 / kept - 1 > TOLD, 1 / kept - 1, 0.0)
        information = (axes * gained) @ axes.T
        shift = np.where(gained > 0, axes.T @ (mean - prior_mean) / kept, 0.0)
        return Told(information, information @ prior_mean + axes @ shift)

    def pulls(self, mean: Array, covariance: Array) -> Array:
        """(K,) how far each number's estimate ends from what is expected, (K,) and (K, K), in the
        standard deviations which that has if the camera is as expected; 0 where the views say
        nothing of it.
        """
        after = np.linalg.inv(self.information + np.linalg.inv(covariance))
        moved = after @ (self.score - self.information @ mean)
        allowed = (covariance - after).diagonal()
        told = allowed > TOLD * covariance.diagonal()
        return np.asarray(np.where(told, moved, 0.0) / np.sqrt(np.where(told, allowed, 1.0)))


@dataclass(frozen=True, slots=True)
class Surprise:
    """How far a camera is from what its prior expects, where its views tell it."""

    square: float
    """Of the distance, in the standard deviations that it may have."""
    directions: int
    """Of how many."""
    p_value: float
    """Of a camera of the fleet that is as far or farther."""


def surprise(told: Told, mean: Array, covariance: Array) -> Surprise:
    """Of a camera that did not contribute to what is expected of it, (K,) and (K, K)."""
    root = np.linalg.cholesky(covariance)
    gained, axes = np.linalg.eigh(root.T @ told.information @ root)
    pull = axes.T @ (root.T @ (told.score - told.information @ mean))
    known = gained > TOLD
    directions = int(known.sum())
    if not directions:
        return Surprise(0.0, 0, 1.0)
    square = float((pull[known] ** 2 / (gained[known] * (1 + gained[known]))).sum())
    return Surprise(square, directions, float(chdtrc(directions, square)))

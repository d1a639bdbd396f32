"""How the numbers of cameras of one make are spread: their mean and spread over cameras, from fits
that each know them only so well.

The model: a camera's numbers are drawn from normal distributions, each number from its own, as a
    line's deviations have causes of their
own; and its views tell them by a likelihood that may leave directions open. The means have the
tolerances of what is declared as their prior, the spreads one that says next to nothing below the
tolerance (half-t). A Gibbs sampler draws from all that fits the cameras; the next camera's numbers
are what these draws say together, so that few cameras, or unsure ones, give a wide answer.

Source: A. Gelman, Prior distributions for variance parameters in hierarchical models (2006); A.
    Huang, M. P. Wand, Simple marginally
noninformative prior distributions for covariance matrices (2013), for the sampler's form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.estimation.likelihood_information import LikelihoodInformation

Array = NDArray[np.float64]

DRAWS = 1500
ROUGHLY = 300
"""Draws, where a factor of a sigma does not matter."""
BURN_IN = 300
FREEDOM = 2.0
"""Of the half-t."""
FEWEST = 4
"""Cameras: of three, a spread is hardly more than a guess."""


@dataclass(frozen=True, slots=True, eq=False)
class Population:
    """Of the K numbers of a camera nobody has seen yet."""

    mean: Array
    covariance: Array
    """(K, K): what cameras differ by, and what is not known of it, together."""
    cameras: int


def population(
    cameras: Sequence[LikelihoodInformation], centre: Array, axes: Array, draws: int = DRAWS
) -> Population:
    """What to expect of the next camera.

    Args:
        centre: (K,) what is declared.
        axes: (K, K), columns that deviate independently from camera to camera, each as long as its
            tolerance.
        draws: fewer will do for a rough answer.
    """
    rng = np.random.default_rng(0)
    count, size = len(cameras), len(centre)
    information = np.stack([axes.T @ one.information @ axes for one in cameras])
    score = np.stack([axes.T @ (one.score - one.information @ centre) for one in cameras])
    spread, loose = np.full(size, 0.1), np.ones(size)
    means, spreads = [], []
    for step in range(BURN_IN + draws):
        inverse = 1 / spread
        within = np.linalg.inv(
            information + np.diag(inverse)
        )  # (N, K, K) of each camera's numbers, the mean being known
        # The mean, with the cameras' own numbers integrated out: drawn given them, it would hardly
        # move.
        precision = np.diag(1 + count * inverse) - inverse[:, None] * within.sum(0) * inverse
        pull = inverse * np.einsum("nij,nj->i", within, score)
        root = np.linalg.cholesky((precision + precision.T) / 2)
        mean = np.linalg.solve(precision, pull) + np.linalg.solve(root.T, rng.standard_normal(size))
        own = np.einsum("nij,nj->ni", within, score + inverse * mean)
        own = own + np.einsum(
            "nij,nj->ni",
            np.linalg.cholesky((within + within.mT) / 2),
            rng.standard_normal((count, size)),
        )
        spread = (FREEDOM / loose + ((own - mean) ** 2).sum(0) / 2) / rng.gamma(
            (FREEDOM + count) / 2, 1.0, size
        )
        loose = (FREEDOM / spread + 1) / rng.gamma((FREEDOM + 1) / 2, 1.0, size)
        if step >= BURN_IN:
            means.append(mean)
            spreads.append(np.minimum(spread, 1.0))
    middle = np.mean(means, axis=0)
    expected = _at_most_one(
        np.diag(np.mean(spreads, axis=0)) + np.cov(np.array(means).T).reshape(size, size)
    )
    return Population(centre + axes @ middle, axes @ expected @ axes.T, count)


def _at_most_one(spread: Array) -> Array:
    """With no direction beyond the tolerances: whatever a fleet says, a camera is what it is
    declared to be as well as any.
    """
    size, axes = np.linalg.eigh((spread + spread.T) / 2)
    return np.asarray((axes * np.minimum(size, 1.0)) @ axes.T)

"""A hierarchical model of the numbers of cameras of one make: their mean and their spread over
cameras, from fits that are uncertain themselves.

Each number of a camera is drawn from its own normal distribution, because the deviations of a
production line have separate causes. A camera's views determine its numbers by a likelihood that
may be flat in some directions. The prior of a mean has the tolerance of the declared value. The
prior of a spread (half-t) is nearly flat below the tolerance. A Gibbs sampler draws means and
spreads from their posterior. The numbers expected of the next camera average over these draws, so
that few or uncertain cameras give a wide expectation.

Source: A. Gelman, Prior distributions for variance parameters in hierarchical models (2006); A.
Huang, M. P. Wand, Simple marginally noninformative prior distributions for covariance matrices
(2013), for the sampler's form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.estimation.likelihood_information import LikelihoodInformation

Array = NDArray[np.float64]

DRAWS = 1500
ROUGH_DRAWS = 300
"""Draws that suffice if a factor of a sigma does not matter."""
BURN_IN = 300
FREEDOM = 2.0
"""Degrees of freedom of the half-t prior."""
MIN_PRIOR_CAMERAS = 4
"""A spread over three cameras is hardly more than a guess."""


@dataclass(frozen=True, slots=True, eq=False)
class Population:
    """The expected K numbers of a camera that has no views yet."""

    mean: Array
    covariance: Array
    """(K, K): the spread between cameras and its uncertainty, together."""
    cameras: int


def population(
    cameras: Sequence[LikelihoodInformation], centre: Array, axes: Array, draws: int = DRAWS
) -> Population:
    """Return the expected numbers of the next camera.

    Args:
        centre: (K,) declared values.
        axes: (K, K), columns that deviate independently from camera to camera, each as long as its
            tolerance.
        draws: of the sampler.
    """
    rng = np.random.default_rng(0)
    count, size = len(cameras), len(centre)
    information = np.stack([axes.T @ camera.information @ axes for camera in cameras])
    score = np.stack([axes.T @ (camera.score - camera.information @ centre) for camera in cameras])
    spread = np.full(size, 0.1)
    scale = np.ones(size)  # the auxiliary variables of the half-t
    means: list[Array] = []
    spreads: list[Array] = []
    for step in range(BURN_IN + draws):
        inverse = 1 / spread
        # (N, K, K) covariances of the cameras' numbers, for a given mean.
        conditional = np.linalg.inv(information + np.diag(inverse))
        # The mean is drawn with the cameras' numbers integrated out: given them, it would hardly
        # move.
        precision = np.diag(1 + count * inverse) - inverse[:, None] * conditional.sum(0) * inverse
        pull = inverse * np.einsum("nij,nj->i", conditional, score)
        root = np.linalg.cholesky((precision + precision.T) / 2)
        mean = np.linalg.solve(precision, pull) + np.linalg.solve(root.T, rng.standard_normal(size))
        numbers = np.einsum("nij,nj->ni", conditional, score + inverse * mean)
        numbers = numbers + np.einsum(
            "nij,nj->ni",
            np.linalg.cholesky((conditional + conditional.mT) / 2),
            rng.standard_normal((count, size)),
        )
        spread = (FREEDOM / scale + ((numbers - mean) ** 2).sum(0) / 2) / rng.gamma(
            (FREEDOM + count) / 2, 1.0, size
        )
        scale = (FREEDOM / spread + 1) / rng.gamma((FREEDOM + 1) / 2, 1.0, size)
        if step >= BURN_IN:
            means.append(mean)
            spreads.append(np.minimum(spread, 1.0))
    middle = np.mean(means, axis=0)
    expected = _at_most_one(
        np.diag(np.mean(spreads, axis=0)) + np.cov(np.array(means).T).reshape(size, size)
    )
    return Population(centre + axes @ middle, axes @ expected @ axes.T, count)


def _at_most_one(spread: Array) -> Array:
    """Return a covariance, in units of tolerances, without its excess over 1 in any direction: a
    camera also obeys its declared tolerances.
    """
    size, axes = np.linalg.eigh((spread + spread.T) / 2)
    return np.asarray((axes * np.minimum(size, 1.0)) @ axes.T)

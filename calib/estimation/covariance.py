"""Operations on covariances: the inverse, the root, and the regression on some parameters."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Array = NDArray[np.float64]


def invert_precision(precision: Tensor) -> Tensor:
    """Return the (n, n) covariance, symmetric to the last bit, of parameters whose units may differ
    by any power of ten. A direction that rounding alone determines gets the variance that rounding
    leaves it.
    """
    scale = precision.diagonal().clamp_min(torch.finfo(precision.dtype).tiny).rsqrt()
    scales = scale[:, None] * scale
    scaled = precision * scales
    factor, failed = torch.linalg.cholesky_ex(scaled)
    if failed and torch.isfinite(scaled).all():
        size, vectors = torch.linalg.eigh(scaled)
        size = size.clamp_min(len(size) * torch.finfo(size.dtype).eps)
        covariance = (vectors / size) @ vectors.mT
    else:
        covariance = torch.cholesky_inverse(factor)
    symmetric: Tensor = (covariance + covariance.mT) / 2
    return symmetric * scales


def covariance_root(covariance: Array) -> Array:
    """Return the (n, n) root R of a covariance, R R^T. Eigenvalues that rounding makes negative
    count as zero.

    The root is taken of the correlations: a relief's variances are 1e-12 of a focal length's, and
    would be lost in rounding beside it.
    """
    scale = _positive_spread(covariance)
    variances, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * axes * np.sqrt(np.maximum(variances, 0.0)))


def regression(covariance: Array, entries: NDArray[np.int64]) -> Array:
    """Return the (S, n) change of the mean of all parameters with the values of the parameters at
    `entries`, for their (S, S) covariance.
    """
    block = covariance[np.ix_(entries, entries)]
    scale = _positive_spread(block)
    inverse = np.linalg.pinv(block / np.outer(scale, scale), hermitian=True)
    return np.asarray(covariance[:, entries] / scale @ inverse / scale)


def _positive_spread(covariance: Array) -> Array:
    """Return the (n,) standard deviations, with 1 in place of 0."""
    spread = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    return np.where(spread > 0, spread, 1.0)

"""Robust statistics: what the bulk of some errors says, whatever a few of them say."""

import numpy as np
from numpy.typing import NDArray

SIGMA = 1.4826
"""The standard deviation of a Gaussian over its median absolute deviation."""


def outlying(errors: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of these errors (V,), positive, do not belong with the rest.

    Above four times the median, and above the median by eight robust standard deviations: views
    that are near, tilted or at the edge have larger errors than the rest on an uneven cover, and
    they are what a calibration needs most. What is not finite is outlying.
    """
    if not np.isfinite(errors).any():
        return np.ones(errors.shape, dtype=bool)
    errors = np.where(np.isfinite(errors), errors, np.nan)
    median = float(np.nanmedian(errors))
    spread = SIGMA * float(np.nanmedian(np.abs(errors - median)))
    return ~(errors <= max(4 * median, median + 8 * spread))

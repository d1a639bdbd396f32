"""Robust statistics: estimates from the bulk of some errors that a few outliers do not affect."""

import numpy as np
from numpy.typing import NDArray

SIGMA = 1.4826
"""The standard deviation of a Gaussian over its median absolute deviation."""


def outlier_mask(errors: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the mask of outliers among these positive errors (V,).

    An error is an outlier if it is above four times the median and above the median by eight robust
    standard deviations. Views that are near, tilted or at the edge have larger errors than others
    behind an uneven cover, and a calibration needs them most. An error that is not finite is an
    outlier.
    """
    if not np.isfinite(errors).any():
        return np.ones(errors.shape, dtype=bool)
    errors = np.where(np.isfinite(errors), errors, np.nan)
    median = float(np.nanmedian(errors))
    spread = SIGMA * float(np.nanmedian(np.abs(errors - median)))
    return ~(errors <= max(4 * median, median + 8 * spread))

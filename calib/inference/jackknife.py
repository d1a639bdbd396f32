"""Whether an effect's parameters, estimated from the other views to first order, lower the error of
each view.

Hotelling's statistic divides the views' mean score by their scatter, so that few views, or a few
that say little or are bad, leave it undecided. Here a view is left out instead (a jackknife), and
what the others say of the effect is tried on it.

Source: B. Efron, The jackknife, the bootstrap and other resampling plans (1982), chapter 2.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.inference.sign_flip_test import views_gain

Array = NDArray[np.float64]


def jackknife(
    residuals: Sequence[Array], rows: Sequence[Array], score: Array, hessian: Array
) -> float:
    """p-value of "the effect helps no view that it was not estimated from".

    Args:
        residuals: (2m,) of each view, over sigma; what its own parameters can do is projected out.
        rows: (2m, k) of each view's Jacobian by the effect's parameters likewise.
        score: (k,) of all views together, the prior's share included.
        hessian: (k, k) likewise.
    """
    before, after = [], []
    for residual, own in zip(residuals, rows, strict=True):
        others = np.linalg.lstsq(hessian - own.T @ own, score - own.T @ residual, rcond=None)[0]
        before.append(residual @ residual)
        after.append(((residual - own @ others) ** 2).sum())
    return views_gain(np.array(before).clip(1e-300), np.array(after).clip(1e-300))

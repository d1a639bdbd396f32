"""A jackknife test of an effect: do its parameters, estimated from the other views, lower the error
of each view?

Hotelling's statistic divides the mean score of the views by their scatter. So a few views, or some
with little information or bad corners, leave it undecided. The jackknife leaves a view out instead,
and tests on it the effect that the other views predict, to first order.

Source: B. Efron, The jackknife, the bootstrap and other resampling plans (1982), chapter 2.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.inference.sign_flip_test import gain_p_value

Array = NDArray[np.float64]


def jackknife_p_value(
    residuals: Sequence[Array], jacobians: Sequence[Array], score: Array, hessian: Array
) -> float:
    """Return the p-value of "the effect helps no view that it was not estimated from".

    Args:
        residuals: (2m,) of each view, over sigma; the view's own parameters are projected out.
        jacobians: (2m, k) of each view by the effect's parameters, likewise.
        score: (k,) of all views together, with the prior's share.
        hessian: (k, k) of all views together, with the prior's share.
    """
    base = []
    extended = []
    for residual, jacobian in zip(residuals, jacobians, strict=True):
        hessian_without = hessian - jacobian.T @ jacobian
        score_without = score - jacobian.T @ residual
        estimate = np.linalg.lstsq(hessian_without, score_without, rcond=None)[0]
        base.append(residual @ residual)
        extended.append(((residual - jacobian @ estimate) ** 2).sum())
    return gain_p_value(np.array(base), np.array(extended))

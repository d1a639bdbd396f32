"""The sign-flip test: a permutation test of whether matched pairs differ.

If they do not differ, each difference has either sign with equal probability.

Source: P. Good, Permutation, parametric, and bootstrap tests of hypotheses (2005), section 3.2.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST = 1e-300
"""px^2, in place of 0, which has no logarithm."""
ROUNDING = 1e-12
"""Of a sum, relative to the sum of the absolute values."""
FLIPS = 20_000
"""Random draws of the signs of all views."""


def gain_p_value(base: Array, extended: Array) -> float:
    """Return the p-value of "the errors of these views do not fall".

    The test is made twice, and the smaller p-value doubled. It is made on the logarithm of the
    ratio of the errors, where a view with bad corners counts no more than another, and on the
    difference of the squares, for an effect that only some views show.

    Args:
        base: (V,) px^2, the mean squares of a model; 0 in both if no corner of a view was scored,
            which counts as neither better nor worse.
        extended: (V,) px^2, the mean squares of the model that is to be better.
    """
    by_ratio = sign_flip_p_value(np.log(base.clip(LEAST) / extended.clip(LEAST)))
    by_difference = sign_flip_p_value(base - extended)
    return min(1.0, 2 * min(by_ratio, by_difference))


def sign_flip_p_value(values: Array) -> float:
    """Return the p-value of "these (V,) values are negative as often as positive"."""
    flipped = _signs(len(values)) @ values
    least = values.sum() - ROUNDING * np.abs(values).sum()  # the same signs have the same sum
    return float(((flipped >= least).sum() + 1) / (FLIPS + 1))


@lru_cache(maxsize=1)  # most tests are of the same views
def _signs(count: int) -> Array:
    """Return (FLIPS, count) random signs. The array is shared; do not write to it."""
    return np.random.default_rng(0).choice([-1.0, 1.0], (FLIPS, count))

"""Whether matched pairs differ: the test that flips the signs of their differences, which are as
often one as the other if they do not.

Source: P. Good, Permutation, parametric, and bootstrap tests of hypotheses (2005), section 3.2.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FLIPS = 20_000
"""Of the views' signs."""


def views_gain(before: Array, after: Array) -> float:
    """p-value of "these views' errors, (V,) mean squares before and after, do not fall".

    The test is made twice, and the better p-value doubled: on the logarithm of the errors' ratio,
    in which a view with bad corners counts no more than another, and on the difference of the
    squares, for an effect that only some of the views show.
    """
    return min(
        1.0, 2 * min(views_agree(gains) for gains in (np.log(before / after), before - after))
    )


def views_agree(each: Array) -> float:
    """p-value of "these numbers of views, (V,), are as often negative as positive"."""
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (FLIPS, len(each)))
    return float(((signs @ each >= each.sum()).sum() + 1) / (FLIPS + 1))

"""The test of a check: is the residual of the pictures larger than the calibration's sigma and the
corners' noise allow?

The test asks two questions. Along the directions of every change in the list, is the residual
larger than that of the calibration's own views, each left out in turn? And is the residual as a
whole larger, in a way that noise of the corners does not explain? Each question has its share of
the false alarms. The first divides its share among the changes (Bonferroni), so the stated rate is
an upper bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, stdtr, stdtrit

from calib.checking.overdispersion import Overdispersion, explained_squares
from calib.checking.posterior_predictive import PosteriorPredictive

Array = NDArray[np.float64]

ALPHA = 0.01
"""The stated rate of false alarms."""
SIZE_SHARE = 0.5
"""The share of false alarms of the second question."""


@dataclass(frozen=True, slots=True)
class Significance:
    """The result of the test."""

    p_value: float
    """The p-value of both questions and all changes together. At most a fraction ALPHA of the
    checks of a valid calibration has a smaller one.
    """
    statistic: float
    """The mean over the views of the squares over their prediction, which includes overdispersion
    and the noise of the pictures. Its mean is 1 for a valid calibration.
    """
    allowed: float
    """The largest statistic that is no alarm by itself."""
    freedom: int
    """Degrees of freedom: residuals minus pose parameters."""

    @property
    def significant(self) -> bool:
        """True if the pictures contradict the calibration."""
        return self.p_value < ALPHA


def significance(
    predictive: PosteriorPredictive, overdispersion: Overdispersion, noise_ratio: float
) -> Significance:
    """Test views; `noise_ratio` is the noise variance of their corners over that of the
    calibration's, at least 1.
    """
    products = predictive.normalised_products()
    by_change = [
        _change_p_value(products, predictive, overdispersion, name, noise_ratio)
        for name in predictive.places
    ]
    change_p_value = len(by_change) * min(by_change, default=1.0)
    statistic, allowed, size_p_value = _size_test(predictive, overdispersion, noise_ratio)
    p_value = min(change_p_value / (1 - SIZE_SHARE), size_p_value / SIZE_SHARE, 1.0)
    return Significance(p_value, statistic, allowed, int(predictive.freedom.sum()))


def _change_p_value(
    products: Array,
    predictive: PosteriorPredictive,
    overdispersion: Overdispersion,
    name: str,
    noise_ratio: float,
) -> float:
    square, directions = explained_squares(products, predictive.columns(name))
    if not directions:
        return 1.0
    scale = overdispersion.scale(name, products, predictive.columns(name), directions, noise_ratio)
    return float(
        fdtrc(directions, min(overdispersion.freedom[name], 1e9), square / directions / scale)
    )


def _size_test(
    predictive: PosteriorPredictive, overdispersion: Overdispersion, noise_ratio: float
) -> tuple[float, float, float]:
    """Return the statistic, its largest value without alarm, and its p-value by Student's test of
    the logarithms of the views' squares.
    """
    views = len(predictive.freedom)
    ratios = [
        predictive.normalised_products(slice(view, view + 1))[0, 0]
        / max(1.0, predictive.freedom[view])
        for view in range(views)
    ]
    logs = np.log(np.maximum(ratios, 1e-12)) - np.log(noise_ratio)
    reference = overdispersion.logs if overdispersion.logs.size else np.zeros(1)
    by_theory = float(np.sqrt((2 / np.maximum(predictive.freedom, 1)).mean()))
    spread = max(float(reference.std(ddof=1)), by_theory) if reference.size > 1 else by_theory
    freedom = reference.size - 1 if reference.size > 1 else 1e9
    error = (
        spread * (1 / views + 1 / reference.size) ** 0.5
        if reference.size > 1
        else spread / views**0.5
    )
    typical = max(0.0, float(reference.mean()))
    distance = float(logs.mean()) - typical
    allowed = float(np.exp(float(stdtrit(freedom, 1 - ALPHA * SIZE_SHARE)) * error))
    return float(np.exp(distance)), allowed, float(stdtr(freedom, -distance / error))

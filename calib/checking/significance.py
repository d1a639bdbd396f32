"""The test: whether what the pictures leave is more than the calibration's sigma and the corners'
noise allow.

Two questions are asked. Along every change that is known here, is the residual farther from nothing
than the calibration's own views, left out in turn, are in those directions? And whatever its form,
is it larger, and not by noise of the corners alone? Each has its share of the false alarms, and the
first divides its share among the changes (Bonferroni), so that the rate stated is the most there
is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, stdtr, stdtrit

from calib.checking.dispersion import Dispersion, explained
from calib.checking.equations import Equations

Array = NDArray[np.float64]

ALPHA = 0.01
"""The rate of false alarms that is stated."""
FOR_SIZE = 0.5
"""The share of the second question."""


@dataclass(frozen=True, slots=True)
class Significance:
    """The answer of the test."""

    p_value: float
    """Of both questions and all changes together: below ALPHA in at most that part of the checks of
    a valid calibration.
    """
    statistic: float
    """The mean of the views' squares over what is predicted, the calibration's own dispersion and
    the pictures' noise allowed for: 1 for a valid calibration, on average.
    """
    allowed: float
    """From where the statistic is an alarm by itself."""
    freedom: int
    """Residuals less the poses' numbers."""

    @property
    def significant(self) -> bool:
        return self.p_value < ALPHA


def significance(equations: Equations, dispersion: Dispersion, louder: float) -> Significance:
    """Args: louder: the variance of the pictures' corners over that of the calibration's, at least
    1.
    """
    together = equations.predicted()
    by_change = [
        _of_change(together, equations, dispersion, name, louder) for name in equations.places
    ]
    of_changes = len(by_change) * min(by_change, default=1.0)
    statistic, allowed, of_size = _of_size(equations, dispersion, louder)
    p_value = min(of_changes / (1 - FOR_SIZE), of_size / FOR_SIZE, 1.0)
    return Significance(p_value, statistic, allowed, int(equations.freedom.sum()))


def _of_change(
    together: Array, equations: Equations, dispersion: Dispersion, name: str, louder: float
) -> float:
    square, directions = explained(together, equations.columns(name))
    if not directions:
        return 1.0
    scale = dispersion.scale(name, together, equations.columns(name), directions, louder)
    return float(fdtrc(directions, min(dispersion.freedom[name], 1e9), square / directions / scale))


def _of_size(
    equations: Equations, dispersion: Dispersion, louder: float
) -> tuple[float, float, float]:
    """The statistic, its largest unsuspicious value, and its p-value: Student's test of the
    logarithms of the views' squares.
    """
    views = len(equations.freedom)
    each = [
        equations.predicted(slice(view, view + 1))[0, 0] / max(1.0, equations.freedom[view])
        for view in range(views)
    ]
    logs = np.log(np.maximum(each, 1e-12)) - np.log(louder)
    own = dispersion.logs if dispersion.logs.size else np.zeros(1)
    by_theory = float(np.sqrt((2 / np.maximum(equations.freedom, 1)).mean()))
    spread = max(float(own.std(ddof=1)), by_theory) if own.size > 1 else by_theory
    freedom = own.size - 1 if own.size > 1 else 1e9
    error = spread * (1 / views + 1 / own.size) ** 0.5 if own.size > 1 else spread / views**0.5
    typical = max(0.0, float(own.mean()))
    distance = float(logs.mean()) - typical
    allowed = float(np.exp(float(stdtrit(freedom, 1 - ALPHA * FOR_SIZE)) * error))
    return float(np.exp(distance)), allowed, float(stdtr(freedom, -distance / error))

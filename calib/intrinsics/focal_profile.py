"""How sure a focal length is: the reprojection error over it, all else fitted anew for each (the
profile likelihood).

Views of boards that hardly tilt tell a focal length by little, and the error over it is no
parabola: the linearised standard deviation at its least then says nothing, and there may be several
minima.

Source: D. M. Bates, D. G. Watts, Nonlinear regression analysis and its applications (1988), section
    6.1.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

LEVEL = 3.0
"""Standard deviations, at which the interval is sought: farther out, what is no parabola shows."""
FARTHEST = 3.0
"""Times as long or as short: an interval that is still open there is none."""
SMALLEST_STEP = 1e-4
"""Of the focal length. A linearised standard deviation of less is known to nobody."""
BETTER = 1e-3
"""Of the sum of squares, in its own standard deviations squared: what is lower by more is another
minimum.
"""
LEAST_RMS = 1e-6
"""px: what rounding leaves of corners that are exact."""


class Fit(Protocol):
    """A camera that was fitted to views."""

    @property
    def rms(self) -> float:
        """px"""
        ...


F = TypeVar("F", bound=Fit)


@dataclass(frozen=True, slots=True)
class Interval:
    """What a focal length may be, over its estimate, at LEVEL standard deviations."""

    low: float
    """Below 1; 0 where it is open."""
    high: float
    """Above 1; infinite where it is open."""

    @property
    def closed(self) -> bool:
        return self.low > 0 and bool(np.isfinite(self.high))

    @property
    def sigma(self) -> float:
        """Of the focal length: the longer side over LEVEL."""
        return max(self.high - 1, 1 - self.low) / LEVEL


def profiled(fit: F, refit: Callable[[float], F], freedom: int, sigma: float) -> tuple[Interval, F]:
    """The interval of a focal length, and the best fit that was found on the way: another than
    `fit` where that was not the best.

    Args:
        fit: with its focal length free.
        refit: the same at so many times its focal length.
        freedom: residuals less parameters.
        sigma: of the focal length, linearised.
    """
    best = fit
    ends = []
    for sign in (-1, 1):
        away, reached, before = 0.0, 0.0, 0.0
        step = LEVEL * min(max(sigma, SMALLEST_STEP), 0.1)
        while away < np.log(FARTHEST) and reached < LEVEL:
            away, before = min(max(2 * away, step), np.log(FARTHEST)), away
            there = refit(float(np.exp(sign * away)))
            excess = freedom * (there.rms**2 / max(fit.rms, LEAST_RMS) ** 2 - 1)
            if excess < -BETTER and there.rms < best.rms:
                best = there
            previous, reached = reached, max(0.0, excess) ** 0.5
        share = (LEVEL - previous) / (reached - previous) if LEVEL < reached < np.inf else 1.0
        ends.append(
            float(np.exp(sign * (before + share * (away - before))))
            if reached >= LEVEL
            else (0.0, np.inf)[sign > 0]
        )
    return Interval(*ends), best

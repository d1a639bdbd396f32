"""The profile likelihood of a focal length: the reprojection error over it, with all other
parameters fitted anew at each value.

Views of boards that hardly tilt determine a focal length poorly, and the error over it is no
parabola. The linearised standard deviation at the minimum is then meaningless, and there may be
several minima.

Source: D. M. Bates, D. G. Watts, Nonlinear regression analysis and its applications (1988), section
    6.1.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

LEVEL = 3.0
"""Standard deviations at which the interval is sought: that far out, a deviation from a parabola
shows.
"""
MAX_RATIO = 3.0
"""Largest ratio between a tried focal length and its estimate: a wider interval is open."""
MIN_STEP = 1e-4
"""Smallest relative standard deviation that the first step assumes: no focal length is known
better.
"""
MIN_DECREASE = 1e-3
"""Decrease of the sum of squares, over the noise variance, from which a fit is another minimum."""
MIN_RMS = 1e-6
"""px: the residual of exact corners, from rounding."""


class Fit(Protocol):
    """A camera that is fitted to views."""

    @property
    def rms(self) -> float:
        """Return the root mean square error, px."""
        ...


F = TypeVar("F", bound=Fit)


@dataclass(frozen=True, slots=True)
class Interval:
    """The interval of a focal length at LEVEL standard deviations, relative to its estimate."""

    low: float
    """Lower end, below 1; 0 if open."""
    high: float
    """Upper end, above 1; infinite if open."""

    @property
    def closed(self) -> bool:
        return self.low > 0 and bool(np.isfinite(self.high))

    @property
    def sigma(self) -> float:
        """Return the relative standard deviation: the longer side over LEVEL."""
        return max(self.high - 1, 1 - self.low) / LEVEL


def profile_focal_length(
    fit: F, refit: Callable[[float], F], freedom: int, sigma: float
) -> tuple[Interval, F]:
    """Return the interval of a focal length, and the best fit of the search: `fit`, unless another
    has a lower error.

    Args:
        fit: the fit with a free focal length.
        refit: the fit with the focal length held at the given multiple of the estimate.
        freedom: residuals less parameters.
        sigma: linearised standard deviation of the focal length over its estimate.
    """
    best = fit
    ends = []
    for sign in (-1, 1):
        distance, reached, previous_distance = 0.0, 0.0, 0.0
        step = LEVEL * min(max(sigma, MIN_STEP), 0.1)
        while distance < np.log(MAX_RATIO) and reached < LEVEL:
            previous_distance = distance
            distance = min(max(2 * distance, step), np.log(MAX_RATIO))
            candidate = refit(float(np.exp(sign * distance)))
            excess = freedom * (candidate.rms**2 / max(fit.rms, MIN_RMS) ** 2 - 1)
            if excess < -MIN_DECREASE and candidate.rms < best.rms:
                best = candidate
            previous, reached = reached, max(0.0, excess) ** 0.5
        if reached >= LEVEL:
            fraction = (
                (LEVEL - previous) / (reached - previous) if LEVEL < reached < np.inf else 1.0
            )
            end = previous_distance + fraction * (distance - previous_distance)
            ends.append(float(np.exp(sign * end)))
        else:
            ends.append((0.0, np.inf)[sign > 0])
    return Interval(*ends), best

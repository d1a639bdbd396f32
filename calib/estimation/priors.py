"""The priors of a fit's free parameters: normal distributions whose means are the model's values.
The relief has a prior of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.session.glass import Glass


@dataclass(frozen=True, slots=True, eq=False)
class Priors:
    """The prior covariance of the free parameters, by name. A parameter that has no entry is
    held.
    """

    sigmas: Mapping[str, float | Tensor] = field(default_factory=dict)
    """The standard deviation of each free parameter, in its unit; for a parameter with several
    entries, one for all or one for each.
    """
    correlations: Mapping[tuple[str, str], float] = field(default_factory=dict)
    """The correlations between scalars, each pair once. Other pairs are independent."""

    roots: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """For a parameter with n correlated entries: the (n, n) lower triangular R, in its unit, such
    that R R^T is their covariance. Its entry in `sigmas` is then ignored.
    """

    glass: Glass | None = None
    """The prior of the relief's figure; None for that of any glass.

    Its covariances with the free parameters are used.
    """

    def with_sigmas(self, sigmas: Mapping[str, float | Tensor]) -> Priors:
        """Return these priors with those of further parameters, which are independent."""
        return Priors({**self.sigmas, **sigmas}, self.correlations, self.roots, self.glass)


NONE = Priors()
"""No parameter is free."""

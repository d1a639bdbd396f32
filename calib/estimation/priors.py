"""What is known of a fit's free parameters beforehand, beside the relief: normal priors, whose
means the model's values are.
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
    """Spreads, by the parameters' names. A parameter that has none is held."""

    sigmas: Mapping[str, float | Tensor] = field(default_factory=dict)
    """The standard deviation of each free parameter, in its unit; of one with several entries, one
    for all or one each.
    """
    correlations: Mapping[tuple[str, str], float] = field(default_factory=dict)
    """Between scalars, each pair once. Pairs that are not there are independent."""

    roots: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Of a parameter with n entries that are correlated among themselves: (n, n) R, in its unit,
    lower triangular, with R R^T their covariance. Its sigma above is not read.
    """

    glass: Glass | None = None
    """Of the relief's figure; None: that of any glass.

    Its own covariances with the parameters are read.
    """

    def beside(self, sigmas: Mapping[str, float | Tensor]) -> Priors:
        """These, and those of further parameters, which are independent."""
        return Priors({**self.sigmas, **sigmas}, self.correlations, self.roots, self.glass)


NONE = Priors()
"""Nothing is free."""

"""Laplace's approximation of the evidence around a fit, with the views' own and the shared
parameters integrated out.

The evidence is known for any noise and any prior of the views' own parameters, without a further
fit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from calib.estimation.normal_equations import ReducedProducts
from calib.estimation.objective import view_precision
from calib.inference.fitted_model import FittedModel

NOISE_RANGE = (0.1, 10.0)
"""The range of the noise, relative to that of the fit."""


def view_columns(fitted: FittedModel) -> Iterator[Tensor]:
    """Yield (2m, n) for each view, over the fit's noise: the Jacobian by the view's own parameters,
    that by the shared parameters, and the residual with all parameters at their prior means.
    """
    deviation = torch.from_numpy(fitted.deviation)
    has_prior = view_precision(fitted.model.path, fitted.joint.poses) > 0
    for view, pose in zip(fitted.equations(), fitted.joint.poses, strict=True):
        own_jacobian = torch.from_numpy(view.jacobian_block)
        jacobian = torch.from_numpy(view.jacobian_shared)
        residual = torch.from_numpy(view.residual)
        at_means = residual - own_jacobian @ (pose * has_prior) - jacobian @ deviation
        yield torch.cat([own_jacobian, jacobian, at_means[:, None]], 1)


@dataclass(frozen=True, eq=False)
class LaplaceEvidence:
    """The evidence of corners whose residuals are linear in the parameters."""

    columns: tuple[Tensor, ...]
    """The matrices of `view_columns`."""
    precision: Tensor
    """(S, S) the prior precision of the shared parameters."""

    @classmethod
    def of(cls, fitted: FittedModel) -> LaplaceEvidence:
        """Linearise around a fit."""
        precision = torch.from_numpy(fitted.prior_precision())
        return cls(tuple(view_columns(fitted)), precision)

    @cached_property
    def products(self) -> Tensor:
        """(V, n, n) inner products of each view's columns."""
        return torch.stack([columns.mT @ columns for columns in self.columns])

    @property
    def rows(self) -> int:
        """The number of residuals of all views."""
        return sum(len(columns) for columns in self.columns)

    def log_evidence(self, products: Tensor, own_precision: Tensor, noise: Tensor) -> Tensor:
        """Return (), the logarithm of the evidence up to a constant.

        Args:
            products: (V, n, n) `self.products`, possibly with further parameters eliminated.
            own_precision: (B,) the prior precision of the views' own parameters; 0 without a prior.
            noise: () relative to that of the fit.
        """
        views = ReducedProducts.of(products, own_precision * noise**2)
        reduced = views.products.sum(0) / noise**2
        hessian = reduced[:-1, :-1] + self.precision
        score = reduced[:-1, -1]
        root = torch.linalg.cholesky(hessian)
        explained = torch.linalg.solve_triangular(root, score[:, None], upper=False).square().sum()
        square = reduced[-1, -1] - explained
        freedom = self.rows - len(products) * len(own_precision)
        posterior = views.log_determinant + 2 * root.diagonal().log().sum()
        prior = len(products) * own_precision[own_precision > 0].log().sum()
        twice: Tensor = 2 * freedom * noise.log() + posterior - prior + square
        return -twice / 2

    def max_log_evidence(self, own_precision: Tensor) -> float:
        """Return the largest log evidence over the noise."""
        from scipy.optimize import minimize_scalar  # few fits need it

        def cost(log_noise: float) -> float:
            noise = torch.tensor(np.exp(log_noise), dtype=torch.float64)
            return -float(self.log_evidence(self.products, own_precision, noise))

        solution = minimize_scalar(
            cost, bounds=tuple(np.log(NOISE_RANGE)), method="bounded", options={"xatol": 0.03}
        )
        return -float(solution.fun)

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
from scipy.optimize import minimize_scalar
from torch import Tensor

from calib.estimation.objective import view_precision
from calib.inference.score_test import FittedModel

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


def schur_factors(products: Tensor, own_precision: Tensor) -> tuple[Tensor, Tensor]:
    """Return the factors whose product is subtracted when a view's own parameters are eliminated.

    Args:
        products: (V, B, n) inner products of the own parameters' columns with all columns of
            `view_columns`.
        own_precision: (B,) the prior precision of the own parameters; 0 without a prior.

    Returns:
        (V, B, n - B) L^-1 times the products with the other columns, and (V, B, B) L, the lower
        Cholesky factors of the eliminated blocks.
    """
    size = len(own_precision)
    block = products[:, :, :size] + own_precision.diag()
    cross = products[:, :, size:]
    jitter = (1e-12 * block.diagonal(dim1=1, dim2=2)).clamp_min(1e-30)
    factor = torch.linalg.cholesky(block + torch.diag_embed(jitter))
    return torch.linalg.solve_triangular(factor, cross, upper=False), factor


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
        size = len(own_precision)
        cross, factor = schur_factors(products[:, :size] / noise**2, own_precision)
        rows = cross.flatten(0, 1)
        reduced = products[:, size:, size:].sum(0) / noise**2 - rows.mT @ rows
        hessian = reduced[:-1, :-1] + self.precision
        score = reduced[:-1, -1]
        root = torch.linalg.cholesky(hessian)
        explained = torch.linalg.solve_triangular(root, score[:, None], upper=False).square().sum()
        square = reduced[-1, -1] - explained
        own_determinant = factor.diagonal(dim1=1, dim2=2).log().sum()
        posterior = 2 * (own_determinant + root.diagonal().log().sum())
        prior = len(products) * own_precision[own_precision > 0].log().sum()
        twice: Tensor = 2 * self.rows * noise.log() + posterior - prior + square
        return -twice / 2

    def max_log_evidence(self, own_precision: Tensor) -> float:
        """Return the largest log evidence over the noise."""

        def cost(log_noise: float) -> float:
            noise = torch.tensor(np.exp(log_noise), dtype=torch.float64)
            return -float(self.log_evidence(self.products, own_precision, noise))

        solution = minimize_scalar(
            cost, bounds=tuple(np.log(NOISE_RANGE)), method="bounded", options={"xatol": 0.03}
        )
        return -float(solution.fun)

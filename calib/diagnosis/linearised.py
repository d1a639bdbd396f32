"""How probable the corners are around where a fit ended, views' own and shared parameters
integrated out, for another noise and other
priors of single views than the fit had: it asks for no fit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from scipy.optimize import minimize_scalar
from torch import Tensor

from calib.diagnosis.score_test import Optimum
from calib.estimation.objective import view_precision

NOISES = (0.1, 10.0)
"""Over the fit's: between these it is chosen."""


def columns_of(at: Optimum) -> Iterator[Tensor]:
    """(2m, n) of each view, over the fit's noise: by its own parameters, by the shared ones, and
    what is left with all at their priors' means.
    """
    deviation, known = (
        torch.from_numpy(at.deviation),
        view_precision(at.model.path, at.joint.poses) > 0,
    )
    for view, pose in zip(at.equations(), at.joint.poses, strict=True):
        own, shared = torch.from_numpy(view.jacobian_block), torch.from_numpy(view.jacobian_shared)
        before = torch.from_numpy(view.residual) - own @ (pose * known) - shared @ deviation
        yield torch.cat([own, shared, before[:, None]], 1)


def schur_factors(products: Tensor, own_precision: Tensor) -> tuple[Tensor, Tensor]:
    """What the inner products of a view's columns lose when its own parameters adapt: the products
    of the first of these with themselves.

    Args:
        products: (V, B, n) of its own parameters' columns with all that `columns_of` has.
        own_precision: (B,) of their prior; 0 where nothing is known.

    Returns:
        (V, B, n - B) L^-1 times the products with the other columns, and the (V, B, B) L, the lower
        Cholesky factors of what is eliminated.
    """
    own = len(own_precision)
    block, cross = products[:, :, :own] + own_precision.diag(), products[:, :, own:]
    factor = torch.linalg.cholesky(
        block + torch.diag_embed((1e-12 * block.diagonal(dim1=1, dim2=2)).clamp_min(1e-30))
    )
    return torch.linalg.solve_triangular(factor, cross, upper=False), factor


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals that are linear in the parameters."""

    columns: tuple[Tensor, ...]
    """As `columns_of` has them."""
    precision: Tensor
    """(S, S) of the shared parameters' prior."""

    @classmethod
    def around(cls, at: Optimum) -> Linearised:
        return cls(tuple(columns_of(at)), torch.from_numpy(at.prior_precision()))

    @cached_property
    def products(self) -> Tensor:
        """(V, n, n) inner products of each view's columns."""
        return torch.stack([own.mT @ own for own in self.columns])

    @property
    def rows(self) -> int:
        """Of all views."""
        return sum(len(own) for own in self.columns)

    def log(self, products: Tensor, own_precision: Tensor, noise: Tensor) -> Tensor:
        """() the logarithm up to a constant.

        Args:
            products: (V, n, n) as `products` has them, or what is left of them beside something
                else.
            own_precision: (B,) of the prior of a view's own parameters; 0 where nothing is known.
            noise: () over the fit's.
        """
        own = len(own_precision)
        through, factor = schur_factors(products[:, :own] / noise**2, own_precision)
        rows = through.flatten(0, 1)
        left = products[:, own:, own:].sum(0) / noise**2 - rows.mT @ rows
        hessian, score = left[:-1, :-1] + self.precision, left[:-1, -1]
        root = torch.linalg.cholesky(hessian)
        square = (
            left[-1, -1]
            - torch.linalg.solve_triangular(root, score[:, None], upper=False).square().sum()
        )
        narrowed = 2 * (factor.diagonal(dim1=1, dim2=2).log().sum() + root.diagonal().log().sum())
        before = len(products) * own_precision[own_precision > 0].log().sum()
        twice: Tensor = 2 * self.rows * noise.log() + narrowed - before + square
        return -twice / 2

    def best(self, own_precision: Tensor) -> float:
        """The largest over noises."""

        def badness(log_noise: float) -> float:
            return -float(
                self.log(
                    self.products,
                    own_precision,
                    torch.tensor(np.exp(log_noise), dtype=torch.float64),
                )
            )

        return -float(
            minimize_scalar(
                badness, bounds=tuple(np.log(NOISES)), method="bounded", options={"xatol": 0.03}
            ).fun
        )

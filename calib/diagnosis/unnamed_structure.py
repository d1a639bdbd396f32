"""The rival of what single views have for themselves: structure of no cause, smooth over the board and another one in every view.

Where a model lacks something small in every view, small numbers in every view follow it, whatever they are called. So how probable the
corners are is asked with a Gaussian process over each view's board as well: a sum of three, of different lengths, whose heights, and the
noise beside them, are chosen by evidence. What is said to be a cause has to make them more probable beside that, too.

Source: C. E. Rasmussen, C. K. I. Williams, Gaussian processes for machine learning (2006), sections 2.7 and 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize
from torch import Tensor

from calib.diagnosis.score_test import Optimum
from calib.estimation.objective import view_precision

LENGTHS = (0.25, 0.5, 1.0)
"""Of the board's longer side: of the correlations exp(-d^2 / (2 length^2))."""
HEIGHTS = (0.3, 2.0)
"""Of the noise: where the search begins, of one length after the other."""
LOW = 0.1
"""The others' there."""
LIMITS = (1e-3, 1e2), (0.1, 10.0)
"""Of a height over the noise, and of the noise over the fit's."""
FAINT = 1e-3
"""Of an axis's largest: a mode with a smaller variance is left out."""

BEFOREHAND = 0.05
"""The probability of such structure before corners are looked at: its heights are chosen, and noise has some, too."""
TINY = 1e-12
"""Of the processes' variance: what keeps the root of their covariance real."""


def gain(at: Optimum) -> float:
    """By how much the logarithm of the corners' probability rises where such structure may be, everything else integrated out."""
    corners = at.observations.corners.numpy()
    modes, spread = modes_of(corners)
    deviation, shown, products, inner = torch.from_numpy(at.deviation), torch.from_numpy(modes), [], []
    own_precision = view_precision(at.model.path, at.joint.poses)
    starts = at.observations.starts.tolist()
    for view, pose, first, end in zip(at.equations(), at.joint.poses, starts, starts[1:], strict=False):
        own, shared = torch.from_numpy(view.own), torch.from_numpy(view.shared)
        before = torch.from_numpy(view.residual) - own @ (pose * (own_precision > 0)) - shared @ deviation  # at the priors' means
        columns, here = torch.cat([own, shared, before[:, None]], 1), shown[first:end]
        inner.append(here.mT @ here)
        products.append(Products(here.mT @ columns[::2], here.mT @ columns[1::2], columns.mT @ columns))
    likelihood = Likelihood(
        torch.from_numpy(spread),
        torch.stack(inner),
        Products(*(torch.stack(each) for each in zip(*products, strict=True))),
        own_precision,
        torch.from_numpy(at.prior_precision()),
        2 * len(corners),
    )
    with_it = likelihood.best() - float(likelihood.log(torch.zeros(len(LENGTHS)), torch.ones(())))
    return float(np.logaddexp(np.log(1 - BEFOREHAND), np.log(BEFOREHAND) + with_it))


def modes_of(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Functions over the board that all lengths share, and how large each length's process is in them.

    Returns:
        (M, q) at (M, 2) corners, products of one along x and one along y, orthonormal on the board's grid; and (L, q, q) the covariances
        of their coefficients.
    """
    side = float(np.ptp(corners, axis=0).max())
    functions, spreads = [], []
    for at in corners.T:
        places, index = np.unique(at.round(9), return_inverse=True)
        apart = (places[:, None] - places) ** 2
        kernels = np.stack([np.exp(-apart / (2 * (length * side) ** 2)) for length in LENGTHS])
        size, vectors = np.linalg.eigh(kernels.sum(0))
        kept = vectors[:, size > FAINT * size[-1]]
        functions.append(kept[index])
        spreads.append(kept.T @ kernels @ kept)
    along, down = functions
    modes = (along[:, :, None] * down[:, None]).reshape(len(corners), -1)
    return modes, np.stack([np.kron(wide, high) for wide, high in zip(*spreads, strict=True)])


class Products(NamedTuple):
    """Inner products of columns (a view's own, the shared ones, the residual): of the modes with their rows along x, and along y, and of
    the columns among themselves."""

    x: Tensor
    y: Tensor
    columns: Tensor


@dataclass(frozen=True, slots=True, eq=False)
class Likelihood:
    """Of the linearised corners, over the noise of the fit, for any heights of the processes and any noise."""

    spread: Tensor
    """(L, q, q)."""
    inner: Tensor
    """(V, q, q) of the modes."""
    products: Products
    own_precision: Tensor
    precision: Tensor
    rows: int

    def log(self, heights: Tensor, noise: Tensor) -> Tensor:
        """() the logarithm up to a constant, of (L,) heights over the noise, and a noise over the fit's noise."""
        own = len(self.own_precision)
        each = torch.eye(self.spread.shape[-1], dtype=torch.float64)
        spread = (heights[:, None, None] ** 2 * self.spread).sum(0)
        root = torch.linalg.cholesky(spread + TINY * (1 + spread.diagonal().mean()) * each)
        factor = torch.linalg.cholesky(each + root.mT @ self.inner @ root)
        rest = self.products.columns
        for crossed in (self.products.x, self.products.y):
            through = torch.linalg.solve_triangular(factor, root.mT @ crossed, upper=False)
            rest = rest - through.mT @ through
        logs = 2 * self.rows * noise.log() + 4 * factor.diagonal(dim1=1, dim2=2).log().sum()
        rest = rest / noise**2
        block, cross = rest[:, :own, :own] + self.own_precision.diag(), rest[:, :own, own:]
        factor = torch.linalg.cholesky(block + torch.diag_embed((1e-12 * block.diagonal(dim1=1, dim2=2)).clamp_min(1e-30)))
        logs = logs + 2 * factor.diagonal(dim1=1, dim2=2).log().sum()
        through = torch.linalg.solve_triangular(factor, cross, upper=False)
        left = (rest[:, own:, own:] - through.mT @ through).sum(0)
        hessian, score = left[:-1, :-1] + self.precision, left[:-1, -1]
        square = left[-1, -1] - score @ torch.linalg.solve(hessian, score)
        twice: Tensor = logs + torch.linalg.slogdet(hessian).logabsdet + square
        return -twice / 2

    def best(self) -> float:
        """The largest."""
        count = len(self.spread)
        starts = [
            torch.tensor([height if place == one else LOW for place in range(count)] + [noise], dtype=torch.float64)
            for one in range(count)
            for height in HEIGHTS
            for noise in (0.8, 1.0)
        ]
        first = max(starts, key=lambda at: float(self.log(at[:-1], at[-1])))

        def badness(logs: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
            at = torch.from_numpy(logs).requires_grad_()
            found = -self.log(at[:-1].exp(), at[-1].exp())
            (slope,) = torch.autograd.grad(found, at)
            return float(found.detach()), slope.numpy()

        bounds = np.log([LIMITS[0]] * count + [LIMITS[1]]).tolist()
        return -float(minimize(badness, first.log().numpy(), jac=True, method="L-BFGS-B", bounds=bounds, options={"ftol": 1e-6}).fun)

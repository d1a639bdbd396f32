"""The rival of what single views have for themselves: structure of no cause, smooth over the board and another one in every view.

Where a model lacks something small in every view, small numbers in every view follow it, whatever they are called. So how probable the
corners are is asked with a Gaussian process over each view's board as well, whose height and length, and the noise beside it, are chosen
by evidence: what is said to be a cause has to make them more probable beside that, too.

Source: C. E. Rasmussen, C. K. I. Williams, Gaussian processes for machine learning (2006), sections 2.7 and 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize
from torch import Tensor

from calib.diagnosis.score_test import Optimum
from calib.estimation.objective import view_precision

LENGTHS = (0.15, 0.3, 0.6)
"""Of the board's longer side: of the correlation exp(-d^2 / (2 length^2))."""
HEIGHTS = (0.25, 1.0, 4.0)
"""Of the noise: where the search begins."""
FAINT = 1e-3
"""Of the largest: a mode with a smaller variance is left out."""


def gain(at: Optimum) -> float:
    """By how much the logarithm of the corners' probability rises with such structure, everything else integrated out; at least 0."""
    views = list(at.equations())
    own_precision = view_precision(at.model.path, at.joint.poses)
    deviation = torch.from_numpy(at.deviation)
    blocks = []
    for view, pose in zip(views, at.joint.poses, strict=True):
        own, shared = torch.from_numpy(view.own), torch.from_numpy(view.shared)
        before = torch.from_numpy(view.residual) - own @ (pose * (own_precision > 0)) - shared @ deviation  # at the priors' means
        blocks.append(torch.cat([own, shared, before[:, None]], 1))
    corners = at.observations.corners.numpy()
    each = np.split(np.arange(len(corners)), at.observations.starts[1:-1].numpy())
    precision = torch.from_numpy(at.prior_precision())
    found = 0.0
    for length in LENGTHS:
        modes = torch.from_numpy(modes_of(corners, length)).repeat_interleave(2, 0)
        whole = [
            _products(modes[np.repeat(2 * own, 2) + np.tile([0, 1], len(own))], block) for own, block in zip(each, blocks, strict=True)
        ]
        likelihood = Likelihood(torch.stack(whole), 2 * modes.shape[1], own_precision, precision, 2 * len(corners))
        found = max(found, likelihood.best() - likelihood.log(0.0, 1.0))
    return found


def modes_of(corners: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """(M, q) the process at (M, 2) corners by independent standard normal numbers: the eigenvectors of its covariance on the board's grid,
    which is a product of one along x and one along y, times the roots of the eigenvalues."""
    side = float(np.ptp(corners, axis=0).max())
    axes = []
    for at in corners.T:
        places, index = np.unique(at.round(9), return_inverse=True)
        size, vectors = np.linalg.eigh(np.exp(-((places[:, None] - places) ** 2) / (2 * (length * side) ** 2)))
        axes.append((size, vectors[index]))
    (wide, along), (high, down) = axes
    size = np.outer(wide, high)
    i, k = np.nonzero(size > FAINT * size.max())
    return np.asarray(along[:, i] * down[:, k] * np.sqrt(size[i, k]))


def _products(modes: Tensor, block: Tensor) -> Tensor:
    """(n, n) inner products of a view's columns: the modes along x, along y, and the block's."""
    across, along = modes.clone(), modes.clone()
    across[1::2], along[::2] = 0, 0
    columns = torch.cat([across, along, block], 1)
    return columns.mT @ columns


@dataclass(frozen=True, slots=True, eq=False)
class Likelihood:
    """Of the linearised corners, over the noise of the fit, for any height of the process and any noise."""

    products: Tensor
    """(V, n, n): modes, own, shared, residual."""
    modes: int
    own_precision: Tensor
    precision: Tensor
    rows: int

    def log(self, height: float, noise: float) -> float:
        """The logarithm up to a constant, of a height and a noise over the fit's noise."""
        q, own = self.modes, len(self.own_precision)
        rest, logs = self.products[:, q:, q:], self.rows * 2 * np.log(noise)
        if height:
            inner = self.products[:, :q, :q] + torch.eye(q, dtype=torch.float64) / height**2
            cross = self.products[:, :q, q:]
            factor = torch.linalg.cholesky(inner)
            rest = rest - cross.mT @ torch.cholesky_solve(cross, factor)
            logs += 2 * float(factor.diagonal(dim1=1, dim2=2).log().sum()) + len(rest) * q * 2 * np.log(height)
        rest = rest / noise**2
        block, cross = rest[:, :own, :own] + self.own_precision.diag(), rest[:, :own, own:]
        factor = torch.linalg.cholesky(block + torch.diag_embed((1e-12 * block.diagonal(dim1=1, dim2=2)).clamp_min(1e-30)))
        logs += 2 * float(factor.diagonal(dim1=1, dim2=2).log().sum())
        left = (rest[:, own:, own:] - cross.mT @ torch.cholesky_solve(cross, factor)).sum(0)
        hessian, score = left[:-1, :-1] + self.precision, left[:-1, -1]
        square = float(left[-1, -1] - score @ torch.linalg.solve(hessian, score))
        return -0.5 * float(logs + float(torch.linalg.slogdet(hessian).logabsdet) + square)

    def best(self) -> float:
        """The largest."""
        first = max(((h, s) for h in HEIGHTS for s in (0.7, 1.0)), key=lambda at: self.log(*at))

        def badness(logs: NDArray[np.float64]) -> float:
            return -self.log(*np.exp(logs).tolist())

        return -float(minimize(badness, np.log(first), method="Nelder-Mead", options={"xatol": 0.02, "fatol": 0.05}).fun)

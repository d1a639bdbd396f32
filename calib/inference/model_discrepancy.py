"""The rival of what single views have for themselves: structure of no cause, smooth over the board
and another one in every view.

Where a model lacks something small in every view, small numbers in every view follow it, whatever
they are called. So how probable the corners are is asked with a Gaussian process over each view's
board as well: a sum of three, of different lengths, whose heights, and the noise beside them, are
chosen by evidence. What is said to be a cause has to make them more probable beside that, too.

Source: C. E. Rasmussen, C. K. I. Williams, Gaussian processes for machine learning (2006), sections
    2.7 and 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize
from torch import Tensor

from calib.estimation.objective import view_precision
from calib.inference.laplace_evidence import NOISES, Linearised
from calib.inference.score_test import Optimum

LENGTHS = (0.25, 0.5, 1.0)
"""Of the board's longer side: of the correlations exp(-d^2 / (2 length^2))."""
HEIGHTS = (0.3, 2.0)
"""Of the noise: where the search begins, of one length after the other."""
LOW = 0.1
"""The others' there."""
LIMITS = (1e-3, 1e2)
"""Of a height over the noise."""
FAINT = 1e-3
"""Of an axis's largest: a mode with a smaller variance is left out."""

BEFOREHAND = 0.05
"""The probability of such structure before corners are looked at: its heights are chosen, and noise
has some, too.
"""
TINY = 1e-12
"""Of the processes' variance: what keeps the root of their covariance real."""


def gain(at: Optimum) -> float:
    """By how much the logarithm of the corners' probability rises where such structure may be,
    everything else integrated out.
    """
    modes, spread = modes_of(at.observations.corners.numpy())
    around = Linearised.around(at)
    likelihood = Likelihood(
        around,
        torch.from_numpy(spread),
        [torch.from_numpy(seen) for seen in np.split(modes, at.observations.starts[1:-1].numpy())],
        view_precision(at.model.path, at.joint.poses),
    )
    with_it = likelihood.best() - float(likelihood.log(torch.zeros(len(LENGTHS)), torch.ones(())))
    return float(np.logaddexp(np.log(1 - BEFOREHAND), np.log(BEFOREHAND) + with_it))


def modes_of(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Functions over the board that all lengths share, and how large each length's process is in
    them.

    Returns:
        (M, q) at (M, 2) corners, products of one along x and one along y, orthonormal on the
        board's grid; and (L, q, q) the covariances of their coefficients.
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


class Likelihood:
    """Of the linearised corners beside the processes, for any heights of them and any noise."""

    def __init__(
        self, around: Linearised, spread: Tensor, modes: Sequence[Tensor], own_precision: Tensor
    ) -> None:
        """
        Args:
            spread: (L, q, q), as `modes_of` has it.
            modes: (m, q) of each view's m corners.
            own_precision: (B,) of the prior of a view's own parameters.
        """
        self.around, self.spread, self.own_precision, self.products = (
            around,
            spread,
            own_precision,
            around.products,
        )
        self.inner = torch.stack([seen.mT @ seen for seen in modes])
        self.crossed = [
            torch.stack(
                [seen.mT @ own[axis::2] for seen, own in zip(modes, around.columns, strict=True)]
            )
            for axis in (0, 1)
        ]

    def log(self, heights: Tensor, noise: Tensor) -> Tensor:
        """() the logarithm up to a constant, of (L,) heights over the noise, and a noise over the
        fit's noise.
        """
        each = torch.eye(self.spread.shape[-1], dtype=torch.float64)
        spread = (heights[:, None, None] ** 2 * self.spread).sum(0)
        root = torch.linalg.cholesky(spread + TINY * (1 + spread.diagonal().mean()) * each)
        factor = torch.linalg.cholesky(each + root.mT @ self.inner @ root)
        left = self.products
        for crossed in self.crossed:
            through = torch.linalg.solve_triangular(factor, root.mT @ crossed, upper=False)
            left = left - through.mT @ through
        narrowed: Tensor = 2 * factor.diagonal(dim1=1, dim2=2).log().sum()
        return self.around.log(left, self.own_precision, noise) - narrowed

    def best(self) -> float:
        """The largest."""
        count = len(self.spread)
        starts = [
            torch.tensor(
                [height if place == one else LOW for place in range(count)] + [noise],
                dtype=torch.float64,
            )
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

        bounds = np.log([LIMITS] * count + [NOISES]).tolist()
        return -float(
            minimize(
                badness,
                first.log().numpy(),
                jac=True,
                method="L-BFGS-B",
                bounds=bounds,
                options={"ftol": 1e-6},
            ).fun
        )

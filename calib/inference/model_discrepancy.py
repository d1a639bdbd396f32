"""The evidence of a model discrepancy: structure without a known cause, smooth over the board and
different in every view. Of a target that is not flat, it is smooth over the picture.

If a model lacks something small in every view, any parameters of single views imitate it, whatever
they mean. So such parameters must also raise the evidence beside a Gaussian process over the board
of each view. The process is a sum of three with different lengths. Their heights, and the noise,
maximise the evidence.

Source: C. E. Rasmussen, C. K. I. Williams, Gaussian processes for machine learning (2006), sections
    2.7 and 5.4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from torch import Tensor

from calib.estimation.observations import Observations
from calib.inference.laplace_evidence import NOISE_RANGE, LaplaceEvidence

LENGTHS = (0.25, 0.5, 1.0)
"""Correlation lengths in exp(-d^2 / (2 length^2)), relative to the longer side of the board."""
START_HEIGHTS = (0.3, 2.0)
"""Initial heights of one process over the noise; the search starts from each process in turn."""
LOW_HEIGHT = 0.1
"""The initial height of the other processes."""
HEIGHT_RANGE = (1e-3, 1e2)
"""The range of a height over the noise."""
MAX_NODES = 32
"""Nodes along an axis of a target whose points are on no grid: eight to the shortest length."""
MIN_MODE_VARIANCE = 1e-3
"""The smallest variance of a mode, relative to the largest one along the same axis."""

PRIOR_PROBABILITY = 0.05
"""The prior probability of a discrepancy. Its heights are fitted, so noise alone has some too."""
JITTER = 1e-12
"""Relative to the variance of the processes: keeps the root of their covariance real."""


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """The most probable discrepancy beside a fit."""

    modes: tuple[NDArray[np.float64], ...]
    """(m, q) functions over the board, for each view's m corners."""
    root: NDArray[np.float64]
    """(q, q) a root of the covariance of their coefficients, over the noise of the fit."""

    @staticmethod
    def of(
        evidence: LaplaceEvidence, observations: Observations, own_precision: Tensor
    ) -> Discrepancy:
        """Estimate the heights of the processes.

        Args:
            evidence: that of the linearised corners without a discrepancy.
            own_precision: (B,) the prior precision of the views' own parameters.
        """
        corners = observations.corners
        is_flat = corners.shape[1] == 2
        modes, covariances = board_modes((corners if is_flat else observations.pixels).numpy())
        by_view = np.split(modes, observations.starts[1:-1].numpy())
        likelihood = DiscrepancyLikelihood(
            evidence,
            torch.from_numpy(covariances),
            [torch.from_numpy(view_modes) for view_modes in by_view],
            own_precision,
        )
        root = likelihood.root(likelihood.most_probable())
        return Discrepancy(tuple(by_view), root.numpy())

    def explain(self, view: int, columns: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        """Eliminate the discrepancy from a view's residuals.

        Args:
            columns: (2m, n), x and y of one corner after the other.

        Returns:
            (n, n) by how much the columns' inner products fall, and the log determinant of what was
            eliminated.
        """
        whitening, log_determinant = self._whitening[self.modes[view].tobytes()]
        explained = whitening @ columns.reshape(len(columns) // 2, -1)  # x columns, then y
        explained = explained.reshape(-1, columns.shape[1])
        return explained.T @ explained, log_determinant

    @cached_property
    def _whitening(self) -> Mapping[bytes, tuple[NDArray[np.float64], float]]:
        """For each set of corners, (q, m) from a residual to the part that the discrepancy
        explains, whitened, and the log determinant of what is eliminated.
        """
        results = {}
        for modes in self.modes:
            if (key := modes.tobytes()) not in results:
                functions = modes @ self.root
                gram = np.eye(functions.shape[1]) + functions.T @ functions
                factor = np.linalg.cholesky(gram)
                whitening = solve_triangular(factor, functions.T, lower=True)
                results[key] = whitening, 4 * float(np.log(factor.diagonal()).sum())
        return results


def possible_gain(increase: float) -> float:
    """Return the increase of the log evidence by a discrepancy that is possible, from that by one
    that is certain.
    """
    absent = np.log(1 - PRIOR_PROBABILITY)
    return float(np.logaddexp(absent, np.log(PRIOR_PROBABILITY) + increase))


def board_modes(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return functions over the board that all processes share, and the processes' covariances.

    Returns:
        (M, q) the functions at (M, 2) corners, products of one along x and one along y, orthonormal
        on the board's grid, or on MAX_NODES nodes if there are more coordinates; and (L, q, q) the
        covariances of their coefficients.
    """
    side = float(np.ptp(corners, axis=0).max())
    functions = []
    covariances = []
    for coordinate in corners.T:
        nodes = np.unique(coordinate.round(9))
        if len(nodes) > MAX_NODES:
            nodes = np.linspace(nodes[0], nodes[-1], MAX_NODES)
        kernels = _kernels(nodes, nodes, side)
        variances, vectors = np.linalg.eigh(kernels.sum(0))
        large = variances > MIN_MODE_VARIANCE * variances[-1]
        basis = vectors[:, large]
        # Nystroem's extension of the modes, which at the nodes is the modes themselves
        at_corners = _kernels(coordinate, nodes, side).sum(0)
        functions.append(at_corners @ basis / variances[large])
        covariances.append(basis.T @ kernels @ basis)
    modes = (functions[0][:, :, None] * functions[1][:, None]).reshape(len(corners), -1)
    products = [np.kron(x, y) for x, y in zip(covariances[0], covariances[1], strict=True)]
    return modes, np.stack(products)


def _kernels(
    first: NDArray[np.float64], second: NDArray[np.float64], side: float
) -> NDArray[np.float64]:
    """Return the (L, m, n) covariances of the processes between (m,) and (n,) coordinates."""
    squares = (first[:, None] - second) ** 2
    return np.stack([np.exp(-squares / (2 * (length * side) ** 2)) for length in LENGTHS])


class DiscrepancyLikelihood:
    """The evidence of linearised corners with a discrepancy, for any heights and any noise."""

    def __init__(
        self,
        evidence: LaplaceEvidence,
        covariances: Tensor,
        modes: Sequence[Tensor],
        own_precision: Tensor,
    ) -> None:
        """Precompute inner products.

        Args:
            covariances: (L, q, q) from `board_modes`.
            modes: (m, q) from `board_modes`, for each view's m corners.
            own_precision: (B,) the prior precision of the views' own parameters.
        """
        self.evidence = evidence
        self.covariances = covariances
        self.own_precision = own_precision
        self.mode_products = torch.stack([view_modes.mT @ view_modes for view_modes in modes])
        self.cross_products = [
            torch.stack(
                [
                    view_modes.mT @ columns[axis::2]
                    for view_modes, columns in zip(modes, evidence.columns, strict=True)
                ]
            )
            for axis in (0, 1)
        ]

    def log_evidence(self, heights: Tensor, noise: Tensor) -> Tensor:
        """Return (), the log evidence up to a constant.

        Args:
            heights: (L,) over the noise.
            noise: () relative to that of the fit.
        """
        identity = torch.eye(self.covariances.shape[-1], dtype=torch.float64)
        root = self.root(heights)
        factor = torch.linalg.cholesky(identity + root.mT @ self.mode_products @ root)
        reduced = self.evidence.products
        for cross in self.cross_products:
            eliminated = torch.linalg.solve_triangular(factor, root.mT @ cross, upper=False)
            reduced = reduced - eliminated.mT @ eliminated
        determinant: Tensor = 2 * factor.diagonal(dim1=1, dim2=2).log().sum()
        return self.evidence.log_evidence(reduced, self.own_precision, noise) - determinant

    def root(self, heights: Tensor) -> Tensor:
        """Return the (q, q) Cholesky factor of the covariance of the modes' coefficients, for (L,)
        heights.
        """
        covariance = (heights[:, None, None] ** 2 * self.covariances).sum(0)
        jitter = JITTER * (1 + covariance.diagonal().mean())
        identity = torch.eye(len(covariance), dtype=torch.float64)
        factor: Tensor = torch.linalg.cholesky(covariance + jitter * identity)
        return factor

    def most_probable(self) -> Tensor:
        """Return the (L,) heights with the largest log evidence, over the noise as well."""
        from scipy.optimize import minimize  # few fits need it

        count = len(self.covariances)
        starts = []
        for process in range(count):
            for height in START_HEIGHTS:
                for noise in (0.8, 1.0):
                    heights = [LOW_HEIGHT] * count
                    heights[process] = height
                    starts.append(torch.tensor([*heights, noise], dtype=torch.float64))
        start = max(starts, key=lambda point: float(self.log_evidence(point[:-1], point[-1])))

        def cost(logs: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
            point = torch.from_numpy(logs).requires_grad_()
            value = -self.log_evidence(point[:-1].exp(), point[-1].exp())
            (gradient,) = torch.autograd.grad(value, point)
            return float(value.detach()), gradient.numpy()

        solution = minimize(
            cost,
            start.log().numpy(),
            jac=True,
            method="L-BFGS-B",
            bounds=np.log([HEIGHT_RANGE] * count + [NOISE_RANGE]).tolist(),
            options={"ftol": 1e-6},
        )
        return torch.from_numpy(np.exp(solution.x[:-1]))

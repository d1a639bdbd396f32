"""The normal equations of residuals with a block-sparse Jacobian, and the elimination of the blocks
by the Schur complement. The module knows vectors only.

Each residual depends on S shared parameters and on the B parameters of its own block. So the
Hessian J^T J is block-arrow, and each block's parameters are a linear function of the shared ones,
its response. A block may have a prior: its precision is added to its part of the Hessian. The
orthogonal projection in `calib.estimation.orthogonal_projection` eliminates parameters without a
prior from the residuals themselves.

Source: B. Triggs et al., Bundle adjustment: a modern synthesis (2000), section 6.1.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

NEGLIGIBLE_DAMPING = 1e-12
"""The fraction of the diagonal that keeps a block invertible whose parameters move nothing."""


@dataclass(frozen=True, slots=True)
class LinearisedBlocks:
    """The residuals of some consecutive blocks and their Jacobian at one point, in standard
    deviations and with robust weights.
    """

    starts: Tensor
    """(v + 1,) int64: the rows of the v-th of these blocks are starts[v] to starts[v + 1]."""
    residual: Tensor
    """(M, D)"""
    jacobian_block: Tensor
    """(M, D, B) derivatives by the parameters of the row's own block."""
    jacobian_shared: Tensor
    """(M, D, S) derivatives by the shared parameters."""


@dataclass(frozen=True, slots=True)
class ReducedEquations:
    """The normal equations of the shared parameters after the elimination of all blocks: the
    reduced camera system of bundle adjustment. They are NaN if the full ones are not finite.
    """

    hessian: Tensor
    """(S, S), the Schur complement of the blocks, symmetric up to rounding."""
    gradient: Tensor
    """(S,)"""
    response: Tensor
    """(V, B, S + 1), the response of the blocks to the shared parameters and to their gradient."""

    def block_step(self, step: Tensor) -> Tensor:
        """Return the (V, B) step of the blocks for a (S,) step of the shared parameters, by
        back-substitution.
        """
        return -(self.response[..., -1] + self.response[..., :-1] @ step)


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """The normal equations of the rows, without the prior, by blocks: V blocks of B parameters, and
    S shared parameters.
    """

    hessian_block: Tensor
    """(V, B, B), the diagonal blocks of J^T J."""
    hessian_cross: Tensor
    """(V, B, S)"""
    hessian_shared: Tensor
    """(S, S)"""
    gradient_block: Tensor
    """(V, B), the part of J^T r for the blocks."""
    gradient_shared: Tensor
    """(S,)"""
    sum_of_squares: float
    """The sum of the squared residuals."""

    @property
    def finite(self) -> bool:
        tensors = (
            self.hessian_block,
            self.hessian_cross,
            self.hessian_shared,
            self.gradient_block,
            self.gradient_shared,
        )
        return math.isfinite(self.sum_of_squares) and all(
            bool(torch.isfinite(tensor).all()) for tensor in tensors
        )

    def eliminate_blocks(self, damping: float = NEGLIGIBLE_DAMPING) -> "ReducedEquations":
        """Eliminate all blocks, with a fraction of the diagonal of their Hessian added to it."""
        columns = torch.cat([self.hessian_cross, self.gradient_block.unsqueeze(-1)], -1)
        response = solve(damped(self.hessian_block, damping), columns)
        cross = self.hessian_cross.flatten(0, 1)
        explained = cross.mT @ response.flatten(0, 1)
        return ReducedEquations(
            self.hessian_shared - explained[:, :-1],
            self.gradient_shared - explained[:, -1],
            response,
        )


def normal_equations(pieces: Iterable[LinearisedBlocks]) -> NormalEquations:
    """Return the normal equations of linearised rows, block by block."""
    block, cross, gradient, shared, gradient_shared = [], [], [], [], []
    sum_of_squares = 0.0
    for piece in pieces:
        for first, last in pairwise(piece.starts.tolist()):
            jacobian = piece.jacobian_block[first:last].flatten(0, 1)
            block.append(jacobian.mT @ jacobian)
            cross.append(jacobian.mT @ piece.jacobian_shared[first:last].flatten(0, 1))
            gradient.append(jacobian.mT @ piece.residual[first:last].flatten())
        jacobian, residual = piece.jacobian_shared.flatten(0, 1), piece.residual.flatten()
        shared.append(_gram(jacobian))
        gradient_shared.append(jacobian.mT @ residual)
        sum_of_squares += float(residual @ residual)
    return NormalEquations(
        hessian_block=torch.stack(block),
        hessian_cross=torch.stack(cross),
        hessian_shared=torch.stack(shared).sum(0),
        gradient_block=torch.stack(gradient),
        gradient_shared=torch.stack(gradient_shared).sum(0),
        sum_of_squares=sum_of_squares,
    )


def _gram(columns: Tensor) -> Tensor:
    """Return the (S, S) inner products of (M, S) columns. numpy takes half the operations of a
    general product, because it knows the result as symmetric.
    """
    if columns.device.type != "cpu":
        return columns.mT @ columns
    array = columns.numpy()
    with np.errstate(invalid="ignore", over="ignore"):
        return torch.from_numpy(array.T @ array)


@dataclass(frozen=True, slots=True)
class ReducedProducts:
    """The inner products of each block's columns after the elimination of its parameters."""

    products: Tensor
    """(V, n - B, n - B)"""
    response: Tensor
    """(V, B, n - B), the response of the block's parameters to the other columns."""
    log_determinant: Tensor
    """() the log determinant of the eliminated Hessians of all blocks together."""

    @staticmethod
    def of(products: Tensor, block_precision: Tensor) -> "ReducedProducts":
        """Eliminate the first columns of each block.

        Args:
            products: (V, n, n) inner products of each block's columns: the Jacobian by its
                parameters, then any others.
            block_precision: (B,) the prior precision of its parameters; 0 without a prior.
        """
        size = len(block_precision)
        hessian = damped(products[:, :size, :size] + block_precision.diag())
        cross = products[:, :size, size:]
        response = solve(hessian, cross)
        return ReducedProducts(
            products[:, size:, size:] - cross.mT @ response,
            response,
            torch.linalg.slogdet(hessian).logabsdet.sum(),
        )


def damped(hessian: Tensor, damping: float = NEGLIGIBLE_DAMPING) -> Tensor:
    """Return the (..., n, n) Hessian with this fraction of its diagonal added to it."""
    return hessian + damping * torch.diag_embed(_positive_diagonal(hessian))


def solve(matrix: Tensor, right: Tensor) -> Tensor:
    """Solve `matrix` times x = `right` for (..., n, n) matrices and (..., n, k) or (n,) right
    sides; NaN where a matrix is singular.
    """
    solved, singular = torch.linalg.solve_ex(matrix, right)
    failed = (singular != 0).reshape(singular.shape + (1,) * (right.ndim - singular.ndim))
    return torch.where(failed, torch.nan, solved)


def _positive_diagonal(matrix: Tensor) -> Tensor:
    """Return the (..., n) diagonal, with a floor above zero for parameters that move nothing."""
    diagonal = matrix.diagonal(dim1=-2, dim2=-1)
    floor = 1e-12 * diagonal.amax(-1, keepdim=True) if diagonal.shape[-1] else 0.0
    return diagonal.clamp_min(1e-30) + floor

"""The linearised residuals of each view, and their information about the shared parameters, after
the elimination of the view's own parameters.

These are eliminated by an orthogonal projection of the view's rows, as if they had no prior.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.estimation.objective import LandingProblem, huber_limit, view_precision
from calib.estimation.observations import Observations
from calib.estimation.orthogonal_projection import orthonormal_basis, subtract_projection
from calib.estimation.parameters import Parameters
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.optics.path import Path

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ReducedView:
    """The linearised residuals of one view's m corners, px over sigma, with the fit of the view's
    own parameters subtracted.
    """

    residual: Array
    """(2m,)"""
    jacobian: Array
    """(2m, S) by the shared parameters."""
    freedom: int
    """The degrees of freedom: the visible rows minus the directions of the view's parameters."""

    @property
    def information(self) -> Array:
        """The (S, S) information about the shared parameters."""
        return np.asarray(self.jacobian.T @ self.jacobian)


@dataclass(frozen=True, slots=True, eq=False)
class ViewEquations:
    """The linearised residuals of one view's m corners, px over sigma, x and y of one corner after
    the other.
    """

    residual: Array
    """(2m,)"""
    jacobian_block: Array
    """(2m, B) Jacobian by the view's parameters."""
    jacobian_shared: Array
    """(2m, S) Jacobian by the shared parameters."""

    def reduce(self, columns: NDArray[np.int64] | slice = slice(None)) -> ReducedView:
        """Eliminate the view's own parameters, or those of some columns of `jacobian_block`."""
        block = self.jacobian_block[:, columns]
        basis = orthonormal_basis(block)
        return ReducedView(
            subtract_projection(basis, self.residual),
            subtract_projection(basis, self.jacobian_shared),
            int(np.count_nonzero(block.any(1))) - basis.shape[1],
        )


def view_equations(
    path: Path,
    parameters: Parameters,
    observations: Observations,
    poses: Tensor,
    sigma: float,
    weights: Tensor | None = None,
) -> Iterator[ViewEquations]:
    """Yield every view's equations at the origin of the shared parameters and at (V, B) view
    parameters. The rows of a corner that the model cannot see are zero, so it carries no
    information.

    Args:
        path: the path of the model.
        parameters: the shared parameters.
        observations: the corners of the views.
        poses: (V, B) view parameters.
        sigma: px per axis.
        weights: (M, 2, 2) the `pixel_weights` at these parameters; None to compute them.
    """
    problem = landing_problem(path, parameters, observations, poses, sigma, weights)
    for piece in problem.linearise(poses.new_zeros(parameters.count), poses):
        for first, last in pairwise(piece.starts.tolist()):
            residual = piece.residual[first:last].flatten().numpy()
            block = piece.jacobian_block[first:last].flatten(0, 1).numpy()
            shared = piece.jacobian_shared[first:last].flatten(0, 1).numpy()
            unseen = np.isnan(residual)
            residual[unseen], block[unseen], shared[unseen] = 0, 0, 0
            yield ViewEquations(residual, block, shared)


def landing_problem(
    path: Path,
    parameters: Parameters,
    observations: Observations,
    poses: Tensor,
    sigma: float,
    weights: Tensor | None = None,
) -> LandingProblem:
    """Return the problem that a fit minimises, with the corners weighted at the origin of the
    shared parameters and at (V, B) view parameters, and without a prior on the shared ones. The
    arguments are those of `view_equations`.
    """
    if weights is None:
        weights = pixel_weights(path, parameters.origin, observations, poses, sigma)
    views = tuple(make_residual_blocks(path, parameters, observations, weights))
    return LandingProblem(
        parameters,
        views,
        poses.new_zeros(parameters.count).diag(),
        view_precision(path, poses),
        huber_limit(observations),
    )


def information(views: Iterable[ViewEquations], count: int) -> Array:
    """Return each view's (V, S, S) information about the S shared parameters."""
    return np.array([view.reduce().information for view in views]).reshape(-1, count, count)

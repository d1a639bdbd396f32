"""The information of views about the shared parameters, after the elimination of each view's
parameters: the least-squares fit of these is projected out of the view's rows (variable projection;
for linear rows, the theorem of Frisch, Waugh and Lovell).

The solver eliminates the same parameters from its normal equations by the Schur complement; this
module projects the rows themselves.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.estimation.objective import LandingProblem, view_precision
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.optics.path import Path

Array = NDArray[np.float64]

MIN_LENGTH = 1e-9
"""A column shorter than this fraction of the longest one moves no corner."""
MIN_SINGULAR_VALUE = 1e-7
"""A direction of normalised columns with a smaller singular value consists of rounding errors."""


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

    @property
    def information(self) -> Array:
        """The (S, S) information about the shared parameters, the view's parameters eliminated."""
        rows = project_out(self.jacobian_block, self.jacobian_shared)
        return np.asarray(rows.T @ rows)


def view_equations(
    path: Path, parameters: Parameters, observations: Observations, poses: Tensor, sigma: float
) -> Iterator[ViewEquations]:
    """Yield every view's equations at the origin of the shared parameters and at (V, B) view
    parameters; sigma is px per axis. The rows of a corner that the model cannot see are zero, so it
    carries no information.
    """
    problem = landing_problem(path, parameters, observations, poses, sigma)
    for piece in problem.linearise(poses.new_zeros(parameters.count), poses):
        for first, last in pairwise(piece.starts.tolist()):
            residual = piece.residual[first:last].flatten().numpy()
            block = piece.jacobian_block[first:last].flatten(0, 1).numpy()
            shared = piece.jacobian_shared[first:last].flatten(0, 1).numpy()
            unseen = np.isnan(residual)
            residual[unseen], block[unseen], shared[unseen] = 0, 0, 0
            yield ViewEquations(residual, block, shared)


def landing_problem(
    path: Path, parameters: Parameters, observations: Observations, poses: Tensor, sigma: float
) -> LandingProblem:
    """Return the problem that a fit minimises, with the corners weighted at the origin of the
    shared parameters and at (V, B) view parameters, and without a prior on the shared ones.
    """
    weights = pixel_weights(path, parameters.origin, observations, poses, sigma)
    views = tuple(make_residual_blocks(path, parameters, observations, weights))
    return LandingProblem(
        parameters, views, poses.new_zeros(parameters.count).diag(), view_precision(path, poses)
    )


def project_out(columns: Array, rows: Array) -> Array:
    """Return the (2m, ...) rows minus their least-squares fit by the (2m, B) columns."""
    q = orthonormal_basis(columns)
    return np.asarray(rows - q @ (q.T @ rows))


def information(views: Iterable[ViewEquations], count: int) -> Array:
    """Return each view's (V, S, S) information about the S shared parameters."""
    return np.array([view.information for view in views]).reshape(-1, count, count)


def orthonormal_basis(columns: Array) -> Array:
    """Return an orthonormal basis of the span of the columns, without directions that are zero up
    to rounding.
    """
    length = np.linalg.norm(columns, axis=0)
    columns = columns[:, length > MIN_LENGTH * max(length.max(initial=0.0), 1e-300)]
    u, s, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return np.asarray(u[:, s > MIN_SINGULAR_VALUE])

"""What views say of the parameters they share, once each view's own are eliminated: the
least-squares fit of a view's own parameters is projected out of its rows (variable projection; for
linear rows, the theorem of Frisch, Waugh and Lovell).

The solver eliminates the same parameters from its normal equations, by the Schur complement; here
the rows themselves are wanted.
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
from calib.estimation.residual_blocks import landings, pixel_weights
from calib.optics.path import Path

Array = NDArray[np.float64]

NOTHING = 1e-9
"""Of the longest column: a shorter one moves no corner."""
DEPENDENT = 1e-7
"""Singular value of columns of length one, below which their direction is rounding alone."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewEquations:
    """The residuals of one view's m corners, linearised; px over sigma, x and y of one corner after
    the other.
    """

    residual: Array
    """(2m,)"""
    own: Array
    """(2m, B) Jacobian by the view's own parameters."""
    shared: Array
    """(2m, S) Jacobian by the shared parameters."""

    @property
    def information(self) -> Array:
        """(S, S) of the shared parameters, the view's own unknown."""
        rows = eliminated(self.own, self.shared)
        return np.asarray(rows.T @ rows)


def view_equations(
    path: Path, parameters: Parameters, observations: Observations, poses: Tensor, sigma: float
) -> Iterator[ViewEquations]:
    """Every view's equations at the origin of the parameters and at (V, B) own ones; sigma is px
    per axis. Those of a corner that the model
    cannot see are 0: it says nothing.
    """
    problem = problem_at(path, parameters, observations, poses, sigma)
    for piece in problem.linearise(poses.new_zeros(parameters.count), poses):
        for first, last in pairwise(piece.starts.tolist()):
            residual = piece.residual[first:last].flatten().numpy()
            own, shared = (
                part[first:last].flatten(0, 1).numpy()
                for part in (piece.jacobian_block, piece.jacobian_shared)
            )
            unseen = np.isnan(residual)
            residual[unseen], own[unseen], shared[unseen] = 0, 0, 0
            yield ViewEquations(residual, own, shared)


def problem_at(
    path: Path, parameters: Parameters, observations: Observations, poses: Tensor, sigma: float
) -> LandingProblem:
    """What a fit minimises there, corners weighed as at the origin of the parameters and at (V, B)
    own ones; no prior of shared ones.
    """
    weights = pixel_weights(path, parameters.origin, observations, poses, sigma)
    views = tuple(landings(path, parameters, observations, weights))
    return LandingProblem(
        parameters, views, poses.new_zeros(parameters.count).diag(), view_precision(path, poses)
    )


def eliminated(own: Array, rows: Array) -> Array:
    """(2m, ...) rows less their least-squares fit by (2m, B) columns."""
    q = orthonormal(own)
    return np.asarray(rows - q @ (q.T @ rows))


def information(views: Iterable[ViewEquations], count: int) -> Array:
    """(V, S, S) of the S shared parameters, from each view."""
    return np.array([view.information for view in views]).reshape(-1, count, count)


def orthonormal(columns: Array) -> Array:
    """An orthonormal basis of what columns span, those left out that move nothing."""
    length = np.linalg.norm(columns, axis=0)
    columns = columns[:, length > NOTHING * max(length.max(initial=0.0), 1e-300)]
    u, s, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return np.asarray(u[:, s > DEPENDENT])

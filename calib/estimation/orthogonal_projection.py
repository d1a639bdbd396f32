"""The orthogonal projection of rows onto what given columns cannot explain: the residual of their
least-squares fit (for linear rows, the theorem of Frisch, Waugh and Lovell).

It eliminates parameters without a prior, and tolerates columns that depend on each other. The Schur
complement in `calib.estimation.normal_equations` eliminates parameters with a prior.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MIN_LENGTH = 1e-9
"""A column shorter than this fraction of the longest one moves no corner."""
MIN_SINGULAR_VALUE = 1e-7
"""A direction of normalised columns with a smaller singular value consists of rounding errors."""


def project_out(columns: Array, rows: Array) -> Array:
    """Return the (m, ...) rows minus their least-squares fit by the (m, B) columns."""
    return subtract_projection(orthonormal_basis(columns), rows)


def subtract_projection(basis: Array, rows: Array) -> Array:
    """Return the (m, ...) rows minus their components along the (m, n) orthonormal basis."""
    return np.asarray(rows - basis @ (basis.T @ rows))


def orthonormal_basis(columns: Array) -> Array:
    """Return an orthonormal basis of the span of the columns, without directions that are zero up
    to rounding.
    """
    length = np.linalg.norm(columns, axis=0)
    columns = columns[:, length > MIN_LENGTH * max(length.max(initial=0.0), 1e-300)]
    u, s, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return np.asarray(u[:, s > MIN_SINGULAR_VALUE])

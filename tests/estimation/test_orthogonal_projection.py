"""The projection of rows, compared with a least-squares fit."""

import numpy as np
import pytest

from calib.estimation.orthogonal_projection import orthonormal_basis, project_out


def test_the_projection_is_the_residual_of_a_least_squares_fit() -> None:
    """The columns may be of any length, may depend on each other, and may be zero."""
    rng = np.random.default_rng(0)
    independent = rng.normal(size=(20, 3))
    columns = np.column_stack(
        [1e6 * independent[:, 0], independent, independent[:, 1] + independent[:, 2], np.zeros(20)]
    )
    rows = rng.normal(size=(20, 4))
    fit = np.linalg.lstsq(independent, rows, rcond=None)[0]
    assert project_out(columns, rows) == pytest.approx(rows - independent @ fit, rel=1e-9)
    assert project_out(columns, rows[:, 0]) == pytest.approx((rows - independent @ fit)[:, 0])
    assert orthonormal_basis(columns).shape == (20, 3)

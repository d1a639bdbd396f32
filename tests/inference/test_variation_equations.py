"""Numbers that differ in many views: the fast way gives the same as eigenvectors."""

import numpy as np
import pytest

from calib.inference import variation_equations
from calib.inference.variation_equations import GroupEquations, Tridiagonal
from calib.inference.varying_numbers import Group

VIEWS, SIZE = 40, 6


@pytest.fixture
def equations() -> GroupEquations:
    """A group of six numbers, of which the last move the corners a hundred times as much."""
    rng = np.random.default_rng(7)
    count = VIEWS * SIZE
    columns = rng.normal(size=(3 * count, count)) * np.tile([1, 1, 1, 100, 100, 100], VIEWS)
    residual = columns @ (0.02 * rng.normal(size=count)) + rng.normal(size=3 * count)
    information, score = columns.T @ columns, columns.T @ residual
    freedom = 5 * count
    return GroupEquations(Group("all", (), ()), information, score, 1.5 * freedom, freedom, SIZE)


def test_a_tridiagonal_matrix_solves_as_the_whole_one(equations: GroupEquations) -> None:
    matrix, right = equations.information, equations.score
    reduced = Tridiagonal.of(matrix)
    whole = np.eye(len(matrix)) + 0.3 * matrix
    solution, log_determinant = reduced.solve(0.3, reduced.turn(right))
    expected = np.linalg.solve(whole, right)
    # LAPACK's errors are of rounding size times the condition of the matrix, 1e5.
    assert np.allclose(reduced.turn(solution, back=True), expected, rtol=0, atol=1e-9)
    assert np.isclose(log_determinant, np.linalg.slogdet(whole).logabsdet, rtol=1e-12)


@pytest.mark.parametrize("side", [(1.0, 0.3), (1.0, 0.0), (0.0, 1.0)])
def test_many_views_gain_what_eigenvectors_say(
    equations: GroupEquations, side: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    sides = np.repeat(side, 3)
    results = []
    for size in (1, 10**6):
        monkeypatch.setattr(variation_equations, "MIN_TRIDIAGONAL", size)
        results.append(equations._of_each(sides))
    (gain, spread, deviations), (expected_gain, expected_spread, expected) = results
    assert spread == expected_spread
    assert np.isclose(gain, expected_gain, rtol=1e-10)
    assert np.allclose(deviations, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    assert gain > 10
    assert not deviations.reshape(VIEWS, SIZE)[:, sides == 0].any()

"""Numbers that differ in many views: the fast ways give the same as one large matrix."""

import numpy as np
import pytest

from calib.inference import variation_equations
from calib.inference.variation_equations import SPREADS, GroupEquations, _Sums
from calib.inference.varying_numbers import Group, VariationKind, centred_pattern

VIEWS, SIZE, SHARED = 40, 6, 5


@pytest.fixture
def rows() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The (M, S) Jacobian of shared parameters, the (M, V G) one of a group of six numbers, of
    which the last move the corners a hundred times as much, and the (M,) residual.
    """
    rng = np.random.default_rng(7)
    count = VIEWS * SIZE
    differing = np.zeros((3 * count, count))
    for view in range(VIEWS):
        chosen = slice(3 * SIZE * view, 3 * SIZE * (view + 1))
        columns = rng.normal(size=(3 * SIZE, SIZE)) * [1, 1, 1, 100, 100, 100]
        differing[chosen, SIZE * view : SIZE * (view + 1)] = columns
    shared = rng.normal(size=(3 * count, SHARED)) + differing @ rng.normal(size=(count, SHARED))
    sizes = np.tile([1, 1, 1, 0.02, 0.02, 0.02], VIEWS) * rng.normal(size=count)
    residual = differing @ sizes + rng.normal(size=3 * count)
    return shared, differing, residual


@pytest.fixture
def equations(rows: tuple[np.ndarray, np.ndarray, np.ndarray]) -> GroupEquations:
    shared, differing, residual = rows
    basis = np.linalg.qr(shared)[0]
    diagonal = differing.T @ differing
    blocks = np.stack([diagonal[i : i + SIZE, i : i + SIZE] for i in range(0, len(diagonal), SIZE)])
    coupling = (basis.T @ differing).reshape(SHARED, VIEWS, SIZE).transpose(1, 0, 2)
    score = differing.T @ (residual - basis @ (basis.T @ residual))
    cost, freedom = float(residual @ residual), len(residual)
    group = Group("all", (), (VariationKind.TWO_KINDS,))
    return GroupEquations(group, blocks, coupling, score.reshape(VIEWS, SIZE), cost, freedom)


@pytest.mark.parametrize("side", [(1.0, 0.3), (1.0, 0.0), (0.0, 1.0)])
def test_many_views_gain_what_eigenvectors_say(
    equations: GroupEquations, side: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    sides = np.repeat(side, 3)
    results = []
    for ratio in (0, 10**6):
        monkeypatch.setattr(variation_equations, "MIN_LOW_RANK", ratio)
        results.append(equations._best_of_each_view(sides))
    (gain, spread, deviations), (expected_gain, expected_spread, expected) = results
    assert spread == expected_spread
    # ROUNDING of the shared parameters' information is added to it
    assert np.isclose(gain, expected_gain, rtol=1e-8)
    assert np.allclose(deviations, expected, rtol=0, atol=1e-7 * np.abs(expected).max())
    assert gain > 10
    assert not deviations[:, sides == 0].any()


def test_a_pattern_gains_what_the_rows_say(
    rows: tuple[np.ndarray, np.ndarray, np.ndarray], equations: GroupEquations
) -> None:
    """The oracle is the determinant and the least squares solution of all rows together."""
    shared, differing, residual = rows
    pattern = centred_pattern(np.arange(VIEWS)[None] >= 15)[0]
    found = equations.variation_along(VariationKind.TWO_KINDS, pattern)
    columns = differing @ np.kron(pattern[:, None], np.eye(SIZE))
    columns -= shared @ np.linalg.lstsq(shared, columns, rcond=None)[0]
    gains = []
    for spread in SPREADS:
        matrix = np.eye(SIZE) + spread**2 * columns.T @ columns
        explained = (
            spread**2 * (columns.T @ residual) @ np.linalg.solve(matrix, columns.T @ residual)
        )
        log_ratio = np.log(1 - explained / (residual @ residual))
        gains.append(-(np.linalg.slogdet(matrix).logabsdet + len(residual) * log_ratio) / 2)
    assert found.gain == pytest.approx(max(gains), rel=1e-9)


def test_views_that_move_in_batches_end_where_they_do_together(
    equations: GroupEquations, monkeypatch: pytest.MonkeyPatch
) -> None:
    ends = []
    for batch in (3, VIEWS):
        monkeypatch.setattr(variation_equations, "MOVED_TOGETHER", batch)
        ends.append(equations.in_two_kinds())
    assert np.array_equal(ends[0].pattern, ends[1].pattern)
    assert ends[0].gain == pytest.approx(ends[1].gain, rel=1e-12)


def test_sums_gain_what_patterns_do(equations: GroupEquations) -> None:
    """Divisions of the views into two kinds are compared by sums over the views of each."""
    order = np.random.default_rng(4).permutation(VIEWS)
    counts = np.arange(1, VIEWS)
    patterns = centred_pattern(order.argsort() < counts[:, None])
    sums = _Sums.of(equations, order).take(counts - 1)
    gains = equations._gains_of_kinds(sums, counts)
    assert gains == pytest.approx(equations._gains_along(patterns)[0], rel=1e-9)

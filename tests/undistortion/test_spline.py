"""Splines against scipy's, which finds knots and derivatives in ways of its own, and against their
definition.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.interpolate import NdBSpline, make_interp_spline

from calib.undistortion.spline import BATCH_SIZE, MIN_NODES, Spline

Array = NDArray[np.float64]

NODES_X, NODES_Y = np.linspace(-20.0, 130.0, 11), np.linspace(-7.5, 80.0, 8)
ROUNDING = 1e-12
"""The tolerance, as a fraction of the largest node value. From values to coefficients, an error
grows at most 15.6-fold along each axis, so one unit of rounding becomes 5e-14 at most: this allows
twenty of them.
"""

rectangle = np.array([[NODES_X[0], NODES_Y[0]], [NODES_X[-1], NODES_Y[-1]]])
node_values = arrays(
    np.float64,
    (len(NODES_Y), len(NODES_X), 2),
    elements=st.floats(-1e4, 1e4, allow_subnormal=False),
)
each_time = settings(max_examples=40, deadline=None, derandomize=True)
"""No deadline: the machines that run this are shared.

The same examples every time: a test that fails once fails again.
"""


def some_values(components: int = 2) -> Array:
    return np.random.default_rng(0).normal(size=(len(NODES_Y), len(NODES_X), components))


def some_points(count: int = 500) -> Array:
    """(N, 2) within the nodes, corners and edges among them."""
    points = rectangle[0] + np.random.default_rng(1).random((count, 2)) * np.diff(rectangle, axis=0)
    onto_edges = np.where(
        np.arange(count)[:, None] % 2 == [0, 1], rectangle[np.arange(count) // 2 % 2], points
    )
    corners = np.stack(np.meshgrid(NODES_X[[0, -1]], NODES_Y[[0, -1]]), -1).reshape(-1, 2)
    return np.vstack([points, onto_edges, corners])


def oracle(values: Array) -> NdBSpline:
    """scipy's, of y and x."""
    downwards = make_interp_spline(NODES_Y, values, 3)
    sideways = make_interp_spline(NODES_X, downwards.c, 3, axis=1)
    return NdBSpline(
        (downwards.t, sideways.t), sideways.c.swapaxes(0, 1), 3
    )  # BSpline keeps its own axis first


def expected(values: Array, points: Array) -> tuple[Array, Array]:
    """scipy's (N, c) values and (N, c, 2) derivatives."""
    spline, yx = oracle(values), np.ascontiguousarray(points[:, ::-1])
    return spline(yx), np.stack([spline(yx, nu=(0, 1)), spline(yx, nu=(1, 0))], -1)


@pytest.mark.parametrize("components", [1, 2, 6])
def test_values_and_derivatives_are_those_of_scipy(components: int) -> None:
    values, points = some_values(components), some_points()
    for ours, theirs in zip(
        Spline.through(NODES_X, NODES_Y, values).at(points), expected(values, points), strict=True
    ):
        assert ours.shape == theirs.shape
        assert np.abs(ours - theirs).max() < ROUNDING * np.abs(values).max()


@each_time
@given(node_values)
def test_any_node_values_give_scipys_spline(values: Array) -> None:
    points = some_points(50)
    for ours, theirs in zip(
        Spline.through(NODES_X, NODES_Y, values).at(points), expected(values, points), strict=True
    ):
        assert np.abs(ours - theirs).max() <= ROUNDING * np.abs(values).max()


@each_time
@given(node_values)
def test_a_spline_takes_its_values_at_the_nodes(values: Array) -> None:
    nodes = np.stack(np.meshgrid(NODES_X, NODES_Y), -1).reshape(-1, 2)
    spline = Spline.through(NODES_X, NODES_Y, values)
    for result in (spline.at(nodes)[0].reshape(values.shape), spline.on_grid(NODES_X, NODES_Y)):
        assert np.abs(result - values).max() <= ROUNDING * np.abs(values).max()


def test_derivatives_agree_with_central_differences() -> None:
    """Steps of 1e-4 between nodes 15 and 12.5 apart: an error of third derivatives times 1e-8 / 6,
    and of rounding over the step, 1e-11.
    """
    step = 1e-4
    spline = Spline.through(NODES_X, NODES_Y, some_values())
    points = some_points(500)[:500]
    _, derivatives = spline.at(points)
    for axis in range(2):
        ahead = spline.at(points + step * np.eye(2)[axis])[0]
        behind = spline.at(points - step * np.eye(2)[axis])[0]
        assert np.abs((ahead - behind) / (2 * step) - derivatives[..., axis]).max() < 1e-9
        assert np.abs(derivatives[..., axis]).max() > 0.05


@pytest.mark.parametrize("count", [0, 1, BATCH_SIZE, BATCH_SIZE + 1])
def test_many_points_are_evaluated_like_few(count: int) -> None:
    spline, points = (
        Spline.through(NODES_X, NODES_Y, some_values()),
        some_points(BATCH_SIZE + 1)[:count],
    )
    values, derivatives = spline.at(points)
    assert (values.shape, derivatives.shape) == ((count, 2), (count, 2, 2))
    for i in {0, count // 2, count - 1} & set(range(count)):
        value, derivative = spline.at(points[i : i + 1])
        assert (values[i] == value[0]).all()
        assert (derivatives[i] == derivative[0]).all()


def test_a_spline_continues_as_the_tangent_plane_beyond_the_nodes() -> None:
    spline, values = Spline.through(NODES_X, NODES_Y, some_values()), some_values()
    points = np.array(
        [[-50.0, 30.0], [200.0, 30.0], [60.0, -40.0], [60.0, 300.0], [-50.0, -40.0], [200.0, 300.0]]
    )
    border = points.clip(*rectangle)
    value, derivatives = expected(values, border)
    extrapolated, carried = spline.at(points)
    assert np.abs(carried - derivatives).max() < ROUNDING * np.abs(values).max()
    plane = value + np.einsum("nca,na->nc", derivatives, points - border)
    assert (
        np.abs(extrapolated - plane).max() < 1e3 * ROUNDING
    )  # up to 220 units away, times derivatives below 1


def test_values_and_derivatives_do_not_jump_at_nodes_and_border() -> None:
    """On both sides of each node and of the border, 1e-9 apart: they differ by second derivatives
    below 1 times that.
    """
    spline = Spline.through(NODES_X, NODES_Y, some_values())
    for nodes, axis in ((NODES_X, 0), (NODES_Y, 1)):
        at = np.full((len(nodes), 2), 33.3)
        at[:, axis] = nodes
        for backward, forward in zip(
            *(spline.at(at + side * np.eye(2)[axis]) for side in (-1e-9, 1e-9)), strict=True
        ):
            assert np.abs(forward - backward).max() < 1e-8


def test_a_cubic_is_its_own_spline() -> None:
    """Not-a-knot ends reproduce every bicubic polynomial, with the fewest nodes too."""

    def cubic(x: Array, y: Array) -> Array:
        return (1 + x - 2 * x**2 + 0.5 * x**3) * (2 - y + y**2 - 3 * y**3)

    nodes = np.linspace(-1, 1, MIN_NODES)
    spline = Spline.through(nodes, nodes, cubic(*np.meshgrid(nodes, nodes))[..., None])
    points = np.random.default_rng(3).uniform(-1, 1, (200, 2))
    assert np.abs(spline.at(points)[0][:, 0] - cubic(*points.T)).max() < 1e-12


@pytest.mark.parametrize(("count_x", "count_y"), [(6, 6), (7, 23), (40, 9)])
def test_grid_and_strips_agree_with_points(count_x: int, count_y: int) -> None:
    """A picture of 97 x 61 px: rows on nodes, several nodes within a row of pixels, several rows
    between nodes.
    """
    width, height = 97, 61
    nodes_x, nodes_y = (
        np.linspace(-0.5, width - 0.5, count_x),
        np.linspace(-3.0, height + 2.0, count_y),
    )
    spline = Spline.through(
        nodes_x, nodes_y, np.random.default_rng(4).normal(size=(count_y, count_x, 3))
    )
    xs, ys = np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64)
    values = spline.at(np.stack(np.meshgrid(xs, ys), -1).reshape(-1, 2))[0].reshape(
        height, width, 3
    )
    assert np.abs(spline.on_grid(xs, ys) - values).max() < 1e-12
    row_count = 0
    for rows, strips in spline.strips(width, height):
        assert rows.start == row_count
        row_count = rows.stop
        assert all(
            strip.dtype == np.float32 and strip.shape == (rows.stop - rows.start, width)
            for strip in strips
        )
        assert (
            np.abs(np.stack(strips, -1) - values[rows]).max() < 3e-6
        )  # float32 of values below 6, four products each
    assert row_count == height

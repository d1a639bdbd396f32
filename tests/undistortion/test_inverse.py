"""Undistorting and distorting again, on random smooth fields that are one to one by construction;
and Newton's method by itself.
"""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from calib.undistortion.grids import grid_nodes
from calib.undistortion.inverse import MIN_DETERMINANT, newton_step, solve_newton
from calib.undistortion.ray_field import RayField

Array = NDArray[np.float64]

WIDTH, HEIGHT = 320, 240
WAVES = 3
"""Half periods across the picture, at most."""
SPACING = 8
"""px between nodes, the finest that maps are solved on.

With 16 a corner's cell may be off by the 0.005 px that make it not valid.
"""
NEAR = 0.25
"""m: the least depth."""
STEEPEST = 0.3
"""The displacement's gradient, of one coordinate, in A and in B / NEAR together: the Jacobian is
the identity and at most 0.3 * sqrt(2) of other things, and on a convex domain that is enough for a
map to be one to one.
"""

amplitudes = arrays(
    np.float64, (2, 2, WAVES, WAVES), elements=st.floats(-1, 1, allow_subnormal=False)
)
depths = st.one_of(st.floats(NEAR, 50.0), st.just(np.inf))
each_time = settings(max_examples=25, deadline=None, derandomize=True)
"""No deadline: the machines that run this are shared.

The same examples every time: a test that fails once fails again.
"""


def some_field(amplitudes: Array) -> RayField:
    """Return a field whose displacement at infinity, and its change with depth, are sums of
    cosines: (2, 2, WAVES, WAVES) A or B, x or y, and waves.
    """
    nodes_x, nodes_y = grid_nodes(WIDTH, SPACING, 20), grid_nodes(HEIGHT, SPACING, 20)
    sideways = np.cos(np.pi * np.outer(np.arange(WAVES), nodes_x / WIDTH))
    downwards = np.cos(np.pi * np.outer(np.arange(WAVES), nodes_y / HEIGHT))
    gradient = (
        np.pi * (WAVES - 1) / min(WIDTH, HEIGHT) * np.sqrt(2) * np.abs(amplitudes).sum((2, 3)).max()
    )
    scaled = amplitudes * STEEPEST / 2 / max(gradient, 1e-3)
    displacement, parallax = np.einsum("acji,jh,iw->ahwc", scaled, downwards, sideways)
    at = np.stack(np.meshgrid(nodes_x, nodes_y), -1)
    shape = at.shape[:2]
    return RayField(
        WIDTH,
        HEIGHT,
        nodes_x,
        nodes_y,
        at + displacement,
        parallax * NEAR,
        np.ones(shape, bool),
        np.zeros(shape),
    )


def some_pixels(count: int) -> Array:
    corners = [[0, 0], [WIDTH - 1, 0], [0, HEIGHT - 1], [WIDTH - 1, HEIGHT - 1]]
    return np.vstack(
        [np.random.default_rng(0).uniform(0, [WIDTH - 1, HEIGHT - 1], (count, 2)), corners]
    )


@each_time
@given(amplitudes, arrays(np.float64, 204, elements=depths))
def test_distorting_what_was_undistorted_gives_the_pixel(amplitudes: Array, depth: Array) -> None:
    """To 1e-6 px, at which Newton's method stops; its last step leaves far less, about that
    squared. Each pixel has its own depth.
    """
    field, pixels = some_field(amplitudes), some_pixels(200)
    projected, is_visible = field.distort_pixels(field.undistort_pixels(pixels, depth), depth)
    assert is_visible.all()
    assert np.abs(projected - pixels).max() < 1e-6


def test_the_jacobian_agrees_with_central_differences() -> None:
    """Each pixel at its own depth.

    Steps of 1e-3 px on coordinates of 320: rounding leaves 1e-10, third derivatives far less.
    """
    field, pixels, step = (
        some_field(np.random.default_rng(1).uniform(-1, 1, (2, 2, WAVES, WAVES))),
        some_pixels(200),
        1e-3,
    )
    depth = np.random.default_rng(2).uniform(NEAR, 1.0, len(pixels))
    _, jacobian = field._undistort_with_jacobian(pixels, depth)
    for axis in range(2):
        ahead = field.undistort_pixels(pixels + step * np.eye(2)[axis], depth)
        behind = field.undistort_pixels(pixels - step * np.eye(2)[axis], depth)
        assert np.abs((ahead - behind) / (2 * step) - jacobian[..., axis]).max() < 1e-9


def test_no_points_give_an_empty_result() -> None:
    projected, is_visible = some_field(np.zeros((2, 2, WAVES, WAVES))).distort_pixels(
        np.empty((0, 2)), 1.0
    )
    assert projected.shape == (0, 2)
    assert is_visible.shape == (0,)


@each_time
@given(amplitudes, depths)
def test_undistorting_a_map_gives_the_picture(amplitudes: Array, depth: float) -> None:
    """To 0.01 px, which maps promise.

    What is not valid lies off the camera's image, or within 0.01 px of its edge.
    """
    field = some_field(amplitudes)
    made = field.map_at(depth)
    picture = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).astype(np.float64)
    sources = np.stack([made.x, made.y], -1).astype(np.float64)[made.valid]
    assert made.valid.mean() > 0.5
    assert (
        np.abs(sources - [(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
        <= np.array([WIDTH, HEIGHT]) / 2 + 1e-4
    ).all()  # float32 of 320
    assert (
        np.linalg.norm(field.undistort_pixels(sources, depth) - picture[made.valid], axis=-1).max()
        < 0.01
    )
    unseen = picture[~made.valid]
    projected, is_visible = field.distort_pixels(unseen, depth)
    in_picture = (
        np.abs(projected - [(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
        < np.array([WIDTH, HEIGHT]) / 2 - 0.01
    )
    assert not (is_visible & in_picture.all(-1)).any()


def test_newtons_method_finds_a_root_and_admits_where_there_is_none() -> None:
    """(x, y) -> (x^2 / 100, x + y), solved for x = 50 and for what no x gives; far starts take
    shortened steps.
    """

    def undistort(pixels: Array, _: NDArray[np.intp]) -> tuple[Array, Array]:
        x, y = pixels.T
        zero = np.zeros_like(x)
        return np.stack([x**2 / 100, x + y], -1), np.stack(
            [x / 50, zero, zero + 1, zero + 1], -1
        ).reshape(-1, 2, 2)

    goal = np.array([[25.0, 80.0], [25.0, 80.0], [-25.0, 80.0]])
    starts = np.array([[60.0, 0.0], [400.0, -300.0], [60.0, 0.0]])
    stored = starts.copy()
    solution, converged = solve_newton(undistort, starts, goal)
    assert converged.tolist() == [True, True, False]
    assert (
        np.abs(solution[:2] - [50, 30]).max() < 1e-9
    )  # quadratic convergence from a step of 1e-6 px at most
    assert (starts == stored).all()


def test_each_point_is_given_its_own_row() -> None:
    """The rows say which of the N points are still being solved: here each has a scale of its own,
    the first has none to solve.
    """
    scales = np.array([1.0, 2.0, 4.0])

    def undistort(pixels: Array, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        return pixels * scales[rows, None], np.eye(2) * scales[rows, None, None]

    solution, converged = solve_newton(
        undistort, np.array([[8.0, 8.0], [0.0, 0.0], [0.0, 0.0]]), np.full((3, 2), 8.0)
    )
    assert converged.all()
    assert np.abs(solution - 8 / scales[:, None]).max() < 1e-12


def test_a_step_is_the_solution_of_the_linear_equation_or_the_error_where_it_folds() -> None:
    rng = np.random.default_rng(0)
    error, jacobian = rng.normal(size=(20, 2)), np.eye(2) + 0.3 * rng.uniform(-1, 1, (20, 2, 2))
    jacobian[0] = [[1.0, 0.0], [0.0, 0.9 * MIN_DETERMINANT]]
    jacobian[1] = [[-1.0, 0.0], [0.0, 1.0]]
    jacobian[2] = np.nan
    step, folded = newton_step(error, jacobian)
    assert folded.tolist() == [True] * 3 + [False] * 17
    assert (
        np.abs(step[3:] - np.linalg.solve(jacobian[3:], error[3:, :, None])[..., 0]).max() < 1e-12
    )
    assert (step[:3] == error[:3]).all()

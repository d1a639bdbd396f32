"""The whole way of a ray: against bisection in numpy, and the laws that every path obeys."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from calib.optics.build import covered_path, footprint, with_relief
from calib.optics.exposure import MIDDLE
from calib.optics.path import Path
from calib.optics.projection import project
from calib.optics.rays import FAILURES, MISSED_INNER, REFLECTED_OUTER
from calib.optics.relief import AMPLITUDES, Relief
from calib.session.shapes.registry import find_shape, shape_names
from fixtures.synthetic import HEIGHT, INTRINSICS, PATCH, WIDTH
from tests.optics import oracle
from tests.optics.oracle import row_derivatives
from tests.optics.shapes import CONE, EXAMPLES, Example, each_shape

LARGER = 1.2


def nominal(
    example: Example = CONE,
    *,
    amplitude: float = 2e-5,
    exact_hit: bool = True,
    changed: Mapping[str, float] | None = None,
) -> tuple[Path, dict[str, torch.Tensor]]:
    path, values = covered_path(INTRINSICS, example.changed(changed or {}))
    rng = np.random.default_rng(3)
    values["relief.amplitudes"] = torch.from_numpy(rng.normal(0, amplitude, (5, 6)))
    return with_relief(path, Relief(*example.patch, (5, 6)), exact_hit=exact_hit), values


def some_pixels(count: int, seed: int = 0) -> torch.Tensor:
    return torch.from_numpy(
        np.random.default_rng(seed).uniform([0, 0], [WIDTH - 1, HEIGHT - 1], (count, 2))
    )


def oracle_rays(
    example: Example, parameters: Mapping[str, float], amplitudes: np.ndarray, pixels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    turn = Rotation.from_rotvec([parameters.get(f"tilt.{axis}", 0.0) for axis in "xyz"]).as_matrix()
    shift = example.origin(parameters)
    low, high = example.patch
    rows, columns = np.linspace(low[0], high[0], 5), np.linspace(low[1], high[1], 6)
    centres = np.array([(first, second) for first in rows for second in columns])
    bump = oracle.bumps(centres, amplitudes.ravel(), (rows[1] - rows[0], columns[1] - columns[0]))

    def own(point: oracle.Vec) -> oracle.Vec:
        return np.asarray((point - shift) @ turn)

    def inner(point: oracle.Vec) -> float:
        return example.height(own(point), parameters)

    def outer(point: oracle.Vec) -> float:
        return inner(point) - parameters["thickness"] - bump(*example.chart(own(point)))

    glass = parameters["refractive_index"]
    surfaces = [(inner, 1.0, glass), (outer, glass, parameters["outside_index"])]
    focal, middle = INTRINSICS.fx.value, [INTRINSICS.cx.value, INTRINSICS.cy.value]
    directions = np.column_stack([(pixels - middle) / focal, np.ones(len(pixels))])
    rays = [
        oracle.through(surfaces, np.zeros(3), direction / np.linalg.norm(direction), 0.08)
        for direction in directions
    ]
    return np.array([o for o, _ in rays]), np.array([d for _, d in rays])


def test_every_shape_has_its_example() -> None:
    assert {"none", *(example.cover.shape for example in EXAMPLES)} == set(shape_names())


@each_shape
def test_a_shape_is_tilted_about_the_axes_that_are_no_symmetry(example: Example) -> None:
    shape = find_shape(example.cover.shape)
    path, _ = covered_path(INTRINSICS, example.cover)
    for stage in path.cover:
        assert {*shape.tilt_axes} == {*"xyz"} - {*stage.surface.symmetry}


@each_shape
@pytest.mark.parametrize("moved", [False, True], ids=["upright", "moved, under water"])
def test_agrees_with_bisection_in_numpy(example: Example, moved: bool) -> None:
    changed = example.moved if moved else {}
    path, values = nominal(example, changed=changed)
    pixels = some_pixels(60)
    rays = path.trace(pixels, values, MIDDLE)
    parameters = {
        name: number.value for name, number in example.changed(changed).parameters.items()
    }
    origins, directions = oracle_rays(
        example, parameters, values["relief.amplitudes"].numpy(), pixels.numpy()
    )
    assert not rays.failure.any()
    # The oracle's normals come from differences of step 1e-5 m: 1e-11 or so of rounding; the
    # bisection stops at 1e-17 m.
    assert np.abs(rays.origin.stacked().numpy() - origins).max() < 1e-13
    assert np.abs(rays.direction.stacked().numpy() - directions).max() < 1e-9


@each_shape
def test_neglecting_the_shift_moves_rays_by_little_but_not_by_nothing(example: Example) -> None:
    pixels = some_pixels(200)

    def directions(*, amplitude: float, exact_hit: bool) -> torch.Tensor:
        path, values = nominal(example, amplitude=amplitude, exact_hit=exact_hit)
        return path.trace(pixels, values, MIDDLE).direction.stacked()

    exact = directions(amplitude=2e-5, exact_hit=True)
    bumps = (exact - directions(amplitude=0.0, exact_hit=True)).norm(dim=-1).max()
    shift = (exact - directions(amplitude=2e-5, exact_hit=False)).norm(dim=-1).max()
    assert 0 < shift < 0.05 * bumps


@each_shape
@pytest.mark.parametrize("batch", [(), (7,), (2, 3), (2, 1, 3)])
def test_any_batch_shape(example: Example, batch: tuple[int, ...]) -> None:
    path, values = nominal(example, changed=example.moved)
    flat = some_pixels(int(np.prod(batch)))
    together = path.trace(flat.reshape(*batch, 2), values, MIDDLE)
    one_by_one = path.trace(flat, values, MIDDLE)
    assert together.failure.shape == batch
    assert torch.equal(together.direction.stacked().reshape(-1, 3), one_by_one.direction.stacked())


@each_shape
def test_derivatives_agree_with_central_differences(example: Example) -> None:
    """Origins and directions together, by every number of the path: some numbers move only one of
    them.
    """
    path, values = nominal(example, changed=example.moved)
    assert {param.name for param in path.params} == {*values}, (
        "the path reads every number of its cover"
    )
    pixels = some_pixels(20)

    def exit_rays(at: dict[str, torch.Tensor]) -> torch.Tensor:
        rays = path.trace(pixels, at, MIDDLE)
        return torch.cat([rays.origin.stacked(), rays.direction.stacked()], -1)

    leaf = {param.name: values[param.name].clone().requires_grad_() for param in path.params}
    rows = [
        torch.autograd.grad(entry, [*leaf.values()], retain_graph=True)
        for entry in exit_rays(leaf).reshape(-1)
    ]
    for param, derivatives in zip(path.params, zip(*rows, strict=True), strict=True):
        index = (2, 3) if derivatives[0].ndim else ()
        size = 1e-3 * param.scale
        step = torch.zeros_like(values[param.name])
        step[index] = size
        forward = exit_rays({**values, param.name: values[param.name] + step})
        backward = exit_rays({**values, param.name: values[param.name] - step})
        numeric = (forward - backward) / (2 * size)
        analytic = torch.stack([slope[index] for slope in derivatives]).reshape(numeric.shape)
        assert numeric.abs().max() > 0, f"{param.name} moves no ray"
        worst = (analytic - numeric).abs().max() / numeric.abs().max()
        assert worst < 1e-6, (  # differences of 1e-3 scales: error (1e-3)^2
            f"{param.name}: off by {worst:.1e} of its own size"
        )


@each_shape
def test_derivatives_by_pixel_agree_with_central_differences(example: Example) -> None:
    path, values = nominal(example, changed=example.moved)
    pixels = some_pixels(20).requires_grad_()
    at = path.trace(pixels, values, MIDDLE).at_depth(torch.tensor(0.5, dtype=torch.float64))
    (derivatives,) = row_derivatives(at, [pixels])
    for axis in range(2):
        step = torch.zeros(2, dtype=torch.float64)
        step[axis] = 1e-2
        forward = path.trace(pixels.detach() + step, values, MIDDLE).at_depth(
            torch.tensor(0.5, dtype=torch.float64)
        )
        backward = path.trace(pixels.detach() - step, values, MIDDLE).at_depth(
            torch.tensor(0.5, dtype=torch.float64)
        )
        assert (
            derivatives[..., axis] - (forward - backward) / 2e-2
        ).abs().max() < 1e-6 * derivatives.abs().max()


@each_shape
def test_failures_are_data_with_finite_gradients(example: Example) -> None:
    path, values = nominal(
        example, amplitude=3e-3, changed={"refractive_index": 2.6}
    )  # bumps so steep that light cannot leave
    values["cover.refractive_index"].requires_grad_()
    rays = path.trace(some_pixels(2000), values, MIDDLE)
    failures = {FAILURES[code] for code in rays.failure.tolist()}
    assert FAILURES[REFLECTED_OUTER] in failures
    total = rays.origin.stacked().sum() + rays.direction.stacked().sum()
    total.backward()  # type: ignore[no-untyped-call]
    assert torch.isfinite(total)
    slope = values["cover.refractive_index"].grad
    assert slope is not None
    assert torch.isfinite(slope)


def test_a_ray_along_a_narrowing_cone_that_never_meets_it_has_missed() -> None:
    path, values = nominal(amplitude=0.0, changed={"radius_slope": 0.9})
    values["camera.fy"] = torch.tensor(400.0, dtype=torch.float64)
    pixels = torch.tensor(
        [[float(values["camera.cx"]), 4000.0]], dtype=torch.float64
    )  # steeply down, where the cone opens faster
    rays = path.trace(pixels, values, MIDDLE)
    assert rays.failure.tolist() == [MISSED_INNER]
    assert torch.isfinite(rays.direction.stacked()).all()


@each_shape
@pytest.mark.parametrize("depth", [0.1, 0.5, 5.0])
def test_projection_is_the_inverse_of_tracing(example: Example, depth: float) -> None:
    path, values = nominal(example, changed=example.moved)
    pixels = some_pixels(500)
    rays = path.trace(pixels, values, MIDDLE)
    points = torch.cat(
        [
            rays.at_depth(torch.tensor(depth, dtype=torch.float64)),
            torch.full((500, 1), depth, dtype=torch.float64),
        ],
        -1,
    )
    assert (project(path, values, points, MIDDLE) - pixels).norm(dim=-1).max() < 1e-6


@each_shape
def test_projection_says_nan_where_no_ray_goes(example: Example) -> None:
    path, values = nominal(example)
    points = torch.tensor(
        [[0.0, 0.0, -1.0], [0.0, 0.0, float("nan")], [0.0, 0.0, 1.0], [50.0, 0.0, 0.01]],
        dtype=torch.float64,
    )
    pixels = project(path, values, points, MIDDLE)
    assert torch.isfinite(pixels).all(-1).tolist() == [False, False, True, False]


@each_shape
def test_projection_says_nan_for_a_point_inside_the_cover(example: Example) -> None:
    """The line of the ray is the light's way only from where it leaves the cover on."""
    path, values = nominal(example)
    rays = path.trace(some_pixels(50), values, MIDDLE)
    in_cover = (rays.origin + rays.direction * torch.tensor(-0.001, dtype=torch.float64)).stacked()
    outside_cover = (
        rays.origin + rays.direction * torch.tensor(0.001, dtype=torch.float64)
    ).stacked()
    assert torch.isnan(project(path, values, in_cover, MIDDLE)).all()
    assert torch.isfinite(project(path, values, outside_cover, MIDDLE)).all()


@each_shape
def test_exit_ray_gives_the_undistorted_pixel_affine_in_inverse_depth(example: Example) -> None:
    """DESIGN: p_u(Z) = A + B / Z exactly, so three depths lie on a line."""
    path, values = nominal(example)
    rays = path.trace(some_pixels(50), values, MIDDLE)
    near = rays.at_depth(torch.tensor(0.1, dtype=torch.float64)) / 0.1
    middle = rays.at_depth(torch.tensor(0.2, dtype=torch.float64)) / 0.2
    far = rays.at_depth(torch.tensor(1.0, dtype=torch.float64)) / 1.0
    slope = (near - far) / (1 / 0.1 - 1 / 1.0)
    assert (far + slope * (1 / 0.2 - 1) - middle).abs().max() < 1e-14


@each_shape
def test_a_relief_grows_with_the_picture_of_its_glass(example: Example) -> None:
    """If every length of the cover is a fifth larger, so is the relief, with the same amplitudes:
    rays leave in the same directions, from places a fifth farther away. A relief that keeps its
    size bends them otherwise.
    """
    path, values = nominal(example, changed=example.moved)
    *inner, outer = path.cover
    assert outer.relief
    view = outer.relief_view(values)
    relief = replace(outer.relief, anchor=view.anchor, size=view.size)
    lengths = {param.name for param in path.params if param.unit == "m"} - {AMPLITUDES}
    larger = {name: LARGER * value if name in lengths else value for name, value in values.items()}
    pixels = some_pixels(50)
    for size, is_same in ((view.size, True), (None, False)):
        tied = replace(outer, relief=replace(relief, size=size))
        path = replace(path, cover=(*inner, tied))
        rays, farther = path.trace(pixels, values, MIDDLE), path.trace(pixels, larger, MIDDLE)
        turn = (farther.direction.stacked() - rays.direction.stacked()).norm(dim=-1).max()
        move = (farther.origin.stacked() - LARGER * rays.origin.stacked()).norm(dim=-1).max()
        assert (bool(turn < 1e-12), bool(move < 1e-13)) == (is_same, is_same)


@each_shape
def test_footprint_holds_every_ray(example: Example) -> None:
    path, values = nominal(example, amplitude=0.0)
    low, high = footprint(path, values, WIDTH, HEIGHT)
    rays = path.trace(some_pixels(500), values, MIDDLE)
    outer = path.cover[-1]
    first, second = outer.surface.chart(outer.frame.at(values).enter(rays.origin))
    assert low[0] <= first.min() <= first.max() <= high[0]
    assert low[1] <= second.min() <= second.max() <= high[1]


def test_the_paper_s_patch_holds_what_its_camera_sees() -> None:
    path, values = nominal(amplitude=0.0)
    outer = path.cover[-1]
    corners = torch.tensor(
        [[x, y] for x in (0.0, WIDTH / 2, WIDTH - 1) for y in (0.0, HEIGHT / 2, HEIGHT - 1)],
        dtype=torch.float64,
    )
    height, around = outer.surface.chart(
        outer.frame.at(values).enter(path.trace(corners, values, MIDDLE).origin)
    )
    assert PATCH[0][0] < height.min() < height.max() < PATCH[1][0], "its 20 mm"
    assert PATCH[0][1] < around.min() < around.max() < PATCH[1][1], "its 30 degrees"


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")
@each_shape
def test_cuda_gives_the_same_rays(example: Example) -> None:
    path, values = nominal(example, changed=example.moved)
    pixels = some_pixels(500)
    on_cpu = path.trace(pixels, values, MIDDLE).direction.stacked()
    on_gpu = path.trace(
        pixels.cuda(), {name: value.cuda() for name, value in values.items()}, MIDDLE
    ).direction.stacked()
    assert (on_cpu - on_gpu.cpu()).abs().max() < 1e-13

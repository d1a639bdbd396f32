"""The whole way of a ray: against bisection in numpy, and the laws that every path obeys."""

import numpy as np
import pytest
import torch

from calib.optics import rotation
from calib.optics.build import covered_path, footprint, with_relief
from calib.optics.path import Path, by_row
from calib.optics.project import project
from calib.optics.rays import FAILURES, MISSED_INNER, REFLECTED_OUTER
from calib.optics.relief import Relief
from calib.schema import Number
from tests.optics import oracle
from tests.scenes import HEIGHT, INTRINSICS, PATCH, WIDTH, paper_cone

TILTS = {"tilt.x": 0.03, "tilt.z": -0.02, "axis_offset.x": 0.002, "outside_index": 1.1}


def nominal(
    *, amplitude: float = 2e-5, exact_hit: bool = True, changed: dict[str, float] | None = None
) -> tuple[Path, dict[str, torch.Tensor]]:
    cover = paper_cone()
    cover = type(cover)("cone", {**cover.numbers, **{name: Number(value) for name, value in (changed or {}).items()}})
    path, values = covered_path(INTRINSICS, cover)
    rng = np.random.default_rng(3)
    values["relief.amplitudes"] = torch.from_numpy(rng.normal(0, amplitude, (5, 6)))
    return with_relief(path, Relief(*PATCH, (5, 6)), exact_hit=exact_hit), values


def some_pixels(count: int, seed: int = 0) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).uniform([0, 0], [WIDTH - 1, HEIGHT - 1], (count, 2)))


def oracle_rays(values: dict[str, torch.Tensor], pixels: torch.Tensor) -> tuple[np.ndarray, np.ndarray]:
    v = {name: value.numpy() for name, value in values.items()}
    tilt = np.array([v.get("cover.tilt.x", 0.0), 0.0, v.get("cover.tilt.z", 0.0)])
    turn = rotation.matrix(torch.from_numpy(tilt)).numpy()  # itself tested against OpenCV
    shift = np.array([v["cover.axis_offset.x"], 0.0, v["cover.axis_offset.z"]])
    rows, columns = np.linspace(PATCH[0][0], PATCH[1][0], 5), np.linspace(PATCH[0][1], PATCH[1][1], 6)
    centres = np.array([(y, theta) for y in rows for theta in columns])
    bump = oracle.bumps(centres, v["relief.amplitudes"].ravel(), (rows[1] - rows[0], columns[1] - columns[0]))

    def inner(point: np.ndarray) -> float:
        x, y, z = (point - shift) @ turn
        return float(np.hypot(x, z) - v["cover.inner_radius"] - v["cover.radius_slope"] * y)

    def outer(point: np.ndarray) -> float:
        x, y, z = (point - shift) @ turn
        return inner(point) - float(v["cover.thickness"]) - bump(y, np.arctan2(x, z))

    glass, outside = float(v["cover.refractive_index"]), float(v["cover.outside_index"])
    rays = []
    for x, y in pixels.numpy():
        direction = np.array([(x - v["camera.cx"]) / v["camera.fx"], (y - v["camera.cy"]) / v["camera.fy"], 1.0])
        direction /= np.linalg.norm(direction)
        rays.append(oracle.through([(inner, 1.0, glass), (outer, glass, outside)], np.zeros(3), direction, 0.08))
    return np.array([o for o, _ in rays]), np.array([d for _, d in rays])


@pytest.mark.parametrize("changed", [{}, TILTS], ids=["upright", "tilted, off-centre, under water"])
def test_agrees_with_bisection_in_numpy(changed: dict[str, float]) -> None:
    path, values = nominal(changed=changed)
    pixels = some_pixels(60)
    rays = path.trace(pixels, values)
    origins, directions = oracle_rays(values, pixels)
    assert not rays.failure.any()
    # The oracle's normals come from differences of step 1e-5 m: 1e-11 or so of rounding; the bisection stops at 1e-17 m.
    assert np.abs(rays.origin.stacked().numpy() - origins).max() < 1e-13
    assert np.abs(rays.direction.stacked().numpy() - directions).max() < 1e-9


def test_neglecting_the_shift_moves_rays_by_little_but_not_by_nothing() -> None:
    pixels = some_pixels(200)

    def directions(*, amplitude: float, exact_hit: bool) -> torch.Tensor:
        path, values = nominal(amplitude=amplitude, exact_hit=exact_hit)
        return path.trace(pixels, values).direction.stacked()

    exact = directions(amplitude=2e-5, exact_hit=True)
    bumps = (exact - directions(amplitude=0.0, exact_hit=True)).norm(dim=-1).max()
    shift = (exact - directions(amplitude=2e-5, exact_hit=False)).norm(dim=-1).max()
    assert 0 < shift < 0.05 * bumps


@pytest.mark.parametrize("shape", [(), (7,), (2, 3), (2, 1, 3)])
def test_any_batch_shape(shape: tuple[int, ...]) -> None:
    path, values = nominal()
    flat = some_pixels(int(np.prod(shape)))
    together = path.trace(flat.reshape(*shape, 2), values)
    one_by_one = path.trace(flat, values)
    assert together.failure.shape == shape
    assert torch.equal(together.direction.stacked().reshape(-1, 3), one_by_one.direction.stacked())


def test_derivatives_agree_with_central_differences() -> None:
    """Origins and directions together, by every number of the path: some numbers move only one of them."""
    path, values = nominal(changed=TILTS)
    pixels = some_pixels(20)

    def exit_rays(at: dict[str, torch.Tensor]) -> torch.Tensor:
        rays = path.trace(pixels, at)
        return torch.cat([rays.origin.stacked(), rays.direction.stacked()], -1)

    for param in path.params:
        here = values[param.name].clone().requires_grad_()
        out = exit_rays({**values, param.name: here})
        index = (2, 3) if here.ndim else ()
        size = 1e-3 * param.scale
        step = torch.zeros_like(values[param.name])
        step[index] = size
        up, down = (exit_rays({**values, param.name: values[param.name] + sign * step}) for sign in (1, -1))
        numeric = (up - down) / (2 * size)
        analytic = torch.stack([torch.autograd.grad(o, here, retain_graph=True)[0][index] for o in out.reshape(-1)]).reshape(out.shape)
        assert numeric.abs().max() > 0, f"{param.name} moves no ray"
        worst = (analytic - numeric).abs().max() / numeric.abs().max()
        assert worst < 1e-6, f"{param.name}: off by {worst:.1e} of its own size"  # differences of 1e-3 scales: error (1e-3)^2


def test_derivatives_by_pixel_agree_with_central_differences() -> None:
    path, values = nominal()
    pixels = some_pixels(20).requires_grad_()
    at = path.trace(pixels, values).at_depth(torch.tensor(0.5, dtype=torch.float64))
    (slopes,) = by_row(at, [pixels])
    for axis in range(2):
        step = torch.zeros(2, dtype=torch.float64)
        step[axis] = 1e-2
        up, down = (path.trace(pixels.detach() + sign * step, values).at_depth(torch.tensor(0.5, dtype=torch.float64)) for sign in (1, -1))
        assert (slopes[..., axis] - (up - down) / 2e-2).abs().max() < 1e-6 * slopes.abs().max()


def test_failures_are_data_with_finite_gradients() -> None:
    path, values = nominal(amplitude=3e-3, changed={"refractive_index": 2.6})  # bumps so steep that light cannot leave
    values["cover.refractive_index"].requires_grad_()
    rays = path.trace(some_pixels(2000), values)
    seen = {FAILURES[code] for code in rays.failure.tolist()}
    assert FAILURES[REFLECTED_OUTER] in seen
    total = rays.origin.stacked().sum() + rays.direction.stacked().sum()
    total.backward()  # type: ignore[no-untyped-call]
    assert torch.isfinite(total)
    slope = values["cover.refractive_index"].grad
    assert slope is not None
    assert torch.isfinite(slope)


def test_a_ray_along_a_narrowing_cone_that_never_meets_it_has_missed() -> None:
    path, values = nominal(amplitude=0.0, changed={"radius_slope": 0.9})
    values["camera.fy"] = torch.tensor(400.0, dtype=torch.float64)
    pixels = torch.tensor([[float(values["camera.cx"]), 4000.0]], dtype=torch.float64)  # steeply down, where the cone opens faster
    rays = path.trace(pixels, values)
    assert rays.failure.tolist() == [MISSED_INNER]
    assert torch.isfinite(rays.direction.stacked()).all()


@pytest.mark.parametrize("depth", [0.1, 0.5, 5.0])
def test_projection_is_the_inverse_of_tracing(depth: float) -> None:
    path, values = nominal(changed=TILTS)
    pixels = some_pixels(500)
    rays = path.trace(pixels, values)
    points = torch.cat([rays.at_depth(torch.tensor(depth, dtype=torch.float64)), torch.full((500, 1), depth, dtype=torch.float64)], -1)
    assert (project(path, values, points) - pixels).norm(dim=-1).max() < 1e-6


def test_projection_says_nan_where_no_ray_goes() -> None:
    path, values = nominal()
    points = torch.tensor([[0.0, 0.0, -1.0], [0.0, 0.0, float("nan")], [0.0, 0.0, 1.0], [50.0, 0.0, 0.01]], dtype=torch.float64)
    seen = project(path, values, points)
    assert torch.isfinite(seen).all(-1).tolist() == [False, False, True, False]


def test_exit_ray_gives_the_undistorted_pixel_affine_in_inverse_depth() -> None:
    """DESIGN: p_u(Z) = A + B / Z exactly, so three depths lie on a line."""
    path, values = nominal()
    rays = path.trace(some_pixels(50), values)
    near, middle, far = (rays.at_depth(torch.tensor(z, dtype=torch.float64)) / z for z in (0.1, 0.2, 1.0))
    slope = (near - far) / (1 / 0.1 - 1 / 1.0)
    assert (far + slope * (1 / 0.2 - 1) - middle).abs().max() < 1e-14


def test_footprint_holds_every_ray() -> None:
    path, values = nominal(amplitude=0.0)
    low, high = footprint(path, values, WIDTH, HEIGHT)
    rays = path.trace(some_pixels(500), values)
    outer = path.cover[-1]
    first, second = outer.surface.chart(outer.frame.enter(rays.origin, values))
    assert low[0] <= first.min() <= first.max() <= high[0]
    assert low[1] <= second.min() <= second.max() <= high[1]
    assert PATCH[0][0] < low[0] < high[0] < PATCH[1][0], "the paper's 20 mm hold what its camera sees"
    assert PATCH[0][1] < low[1] < high[1] < PATCH[1][1], "and so do its 30 degrees"


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")
def test_cuda_gives_the_same_rays() -> None:
    path, values = nominal(changed=TILTS)
    pixels = some_pixels(500)
    here = path.trace(pixels, values).direction.stacked()
    there = path.trace(pixels.cuda(), {name: value.cuda() for name, value in values.items()}).direction.stacked()
    assert (here - there.cpu()).abs().max() < 1e-13

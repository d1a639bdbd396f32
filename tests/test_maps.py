"""Maps against tracing, pixel by pixel."""

import numpy as np
import pytest
import torch

from calib.errors import InputError
from calib.maps import RayField, ray_field
from calib.optics.project import project
from tests.scenes import HEIGHT, WIDTH, Scene, scene


@pytest.fixture(scope="module")
def made() -> Scene:
    return scene(1, views=1, grid=(8, 8), amplitude=3e-5)


@pytest.fixture(scope="module")
def field(made: Scene) -> RayField:
    return ray_field(made.path, made.values, WIDTH, HEIGHT)


def some_pixels(count: int) -> np.ndarray:
    border = [[0, 0], [WIDTH - 1, 0], [0, HEIGHT - 1], [WIDTH - 1, HEIGHT - 1], [WIDTH - 1, HEIGHT // 2], [WIDTH // 2, 0]]
    return np.vstack([np.random.default_rng(0).integers([0, 0], [WIDTH, HEIGHT], (count, 2)), border])


@pytest.mark.parametrize("depth", [0.1, 0.5, 5.0])
def test_map_agrees_with_tracing(made: Scene, field: RayField, depth: float) -> None:
    made_map = field.map_at(depth)
    assert made_map.x.shape == made_map.valid.shape == (HEIGHT, WIDTH)
    assert made_map.x.dtype == np.float32
    pixels = some_pixels(3000)
    v = {name: float(made.values[f"camera.{name}"]) for name in ("fx", "fy", "cx", "cy")}
    tangents = (pixels - [v["cx"], v["cy"]]) / [v["fx"], v["fy"]]
    points = np.column_stack([tangents * depth, np.full(len(pixels), depth)])
    traced = project(made.path, made.values, torch.from_numpy(points)).numpy()
    inside = (np.abs(traced - [(WIDTH - 1) / 2, (HEIGHT - 1) / 2]) <= [WIDTH / 2, HEIGHT / 2]).all(-1)
    column, row = pixels.T
    mapped = np.column_stack([made_map.x[row, column], made_map.y[row, column]])
    clear = (np.abs(np.abs(traced - [(WIDTH - 1) / 2, (HEIGHT - 1) / 2]) - [WIDTH / 2, HEIGHT / 2]) > 0.01).all(-1)
    assert (made_map.valid[row, column] == inside)[clear].all()
    assert inside.mean() > 0.9
    assert np.abs(mapped - traced)[inside & clear].max() < 0.01
    assert (mapped[~inside & clear] == -1).all()


def test_field_is_enough_for_any_depth(made: Scene, field: RayField) -> None:
    """A and B at the nodes, without the model: where the ray of each node meets depth Z, seen by the bare pinhole."""
    rays = made.path.trace(torch.from_numpy(np.stack(np.meshgrid(field.nodes_x, field.nodes_y), -1).reshape(-1, 2)), made.values)
    v = {name: float(made.values[f"camera.{name}"]) for name in ("fx", "fy", "cx", "cy")}
    for depth in (0.1, 0.37, 20.0):
        met = rays.at_depth(torch.tensor(depth, dtype=torch.float64)).numpy() / depth
        expected = met * [v["fx"], v["fy"]] + [v["cx"], v["cy"]]
        assert np.abs((field.infinite + field.parallax / depth).reshape(-1, 2) - expected).max() < 1e-9


def test_where_no_ray_leaves_the_cover_the_map_says_so(made: Scene) -> None:
    """A bump so steep that light is totally reflected on its flanks."""
    values = {**made.values, "relief.amplitudes": made.values["relief.amplitudes"].clone()}
    values["relief.amplitudes"][1, 1] = 3e-3
    values["cover.refractive_index"] = torch.tensor(2.6, dtype=torch.float64)
    field = ray_field(made.path, values, WIDTH // 2, HEIGHT // 2)
    made_map = field.map_at(1.0)
    assert 0.5 < field.valid.mean() < 1
    assert np.isfinite(field.infinite).all()
    assert 0.05 < made_map.valid.mean() < 1


@pytest.mark.parametrize("depth", [0.0, -1.0, float("nan")])
def test_a_depth_that_is_none_is_refused(field: RayField, depth: float) -> None:
    with pytest.raises(InputError, match="write metres above 0"):
        field.map_at(depth)

"""The laws of windows and domes from textbooks, and the rays that cannot meet a cover."""

import numpy as np
import pytest
import torch

from calib.optics.build import covered_path, with_relief
from calib.optics.exposure import MIDDLE
from calib.optics.rays import MISSED_INNER, MISSED_OUTER, Rays
from calib.optics.relief import Relief
from calib.session.cover import Cover
from calib.session.schema import Number
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH
from tests.optics.shapes import CONE, CYLINDER, DOME, FLAT, GLASS, WATER, Example, each_shape

PIXELS = torch.from_numpy(
    np.random.default_rng(0).uniform([0, 0], [WIDTH - 1, HEIGHT - 1], (200, 2))
)


def seen(
    example: Example, pixels: torch.Tensor = PIXELS, **changed: float
) -> tuple[Rays, np.ndarray, np.ndarray, np.ndarray]:
    """Rays through a smooth cover: origins, directions, and the directions that they had at the
    pinhole.
    """
    path, values = covered_path(
        INTRINSICS,
        example.changed({name.replace("__", "."): value for name, value in changed.items()}),
    )
    rays = path.trace(pixels, values, MIDDLE)
    return (
        rays,
        rays.origin.stacked().numpy(),
        rays.direction.stacked().numpy(),
        path.lens(pixels, values).direction.stacked().numpy(),
    )


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.3, -0.2)], ids=["upright", "tilted"])
def test_a_window_in_air_shifts_rays_and_turns_none(tilt: tuple[float, float]) -> None:
    """A parallel plate: shift = t sin(a) (1 - cos(a) / (n cos(b))), towards the normal's side."""
    rays, origins, directions, launched = seen(FLAT, tilt__x=tilt[0], tilt__y=tilt[1])
    assert not rays.failure.any()
    assert np.abs(directions - launched).max() < 1e-15
    angle = np.hypot(*tilt)
    axis = np.array([*tilt, 0.0]) / (angle or 1.0)
    normal = np.array([0.0, 0.0, np.cos(angle)]) + np.sin(angle) * np.cross(
        axis, [0.0, 0.0, 1.0]
    )  # +z turned by the tilt
    cos_in = launched @ normal
    sin_in = np.sqrt(1 - cos_in**2)
    index, thickness = GLASS["refractive_index"], GLASS["thickness"]
    shift = thickness * sin_in * (1 - cos_in / np.sqrt(index**2 - sin_in**2))
    sideways = (normal - cos_in[:, None] * launched) / sin_in[:, None]
    expected = shift[:, None] * sideways
    distance = (
        origins - (origins * directions).sum(-1, keepdims=True) * directions
    )  # from the pinhole to the ray
    assert np.abs(distance - expected).max() < 1e-16
    assert shift.max() > 1e-4, "it does shift them"


def test_the_distance_of_a_tilted_window_is_along_the_optical_axis() -> None:
    axis = torch.tensor([[INTRINSICS.cx.value, INTRINSICS.cy.value]], dtype=torch.float64)
    _, origins, _, _ = seen(FLAT, axis, distance=0.02, tilt__x=0.3, tilt__y=-0.2, thickness=1e-9)
    assert np.abs(origins - [0.0, 0.0, 0.02]).max() < 3e-9


def test_a_tilt_about_x_takes_the_window_s_lower_half_away() -> None:
    """y points down and z forward, so a right-handed turn about x takes +y towards +z."""
    below = torch.tensor([[INTRINSICS.cx.value, HEIGHT - 1.0]], dtype=torch.float64)
    depths = [float(seen(FLAT, below, tilt__x=tilt)[1][0, 2]) for tilt in (-0.1, 0.0, 0.1)]
    assert depths[0] < depths[1] < depths[2]


def test_a_flat_port_magnifies_by_the_index_of_water() -> None:
    """Snell: what leaves at sine s / n launched at sine s, glass or no glass; near the axis
    tangents go as sines.
    """
    _, _, directions, launched = seen(FLAT, outside_index=WATER)
    assert np.abs(directions[:, :2] * WATER - launched[:, :2]).max() < 1e-15
    middle = torch.tensor([[INTRINSICS.cx.value + 1.0, INTRINSICS.cy.value]], dtype=torch.float64)
    _, _, near_axis, _ = seen(FLAT, middle, outside_index=WATER)
    seen_bare = (
        INTRINSICS.fx.value * near_axis[0, 0] / near_axis[0, 2]
    )  # px from the centre, without port and water
    assert 1.0 / seen_bare == pytest.approx(WATER, rel=1e-6)


def test_a_dome_around_the_pinhole_bends_nothing_in_air_or_water() -> None:
    for outside_index in (1.0, WATER):
        _, origins, directions, launched = seen(DOME, centre__z=0.0, outside_index=outside_index)
        assert np.abs(directions - launched).max() < 1e-14
        assert np.abs(origins - launched * (0.05 + GLASS["thickness"])).max() < 1e-16


def test_a_dome_s_paraxial_rays_obey_gauss() -> None:
    """Two refracting spheres, n2 / s2 = n1 / s1 + (n2 - n1) / r (distances positive to the right,
    centres to the left).
    """
    behind = 0.02  # m, from the dome's centre to the pinhole
    radius, outer = 0.05, 0.053
    glass = GLASS["refractive_index"]
    image = -(radius - behind)  # of the pinhole, from the inner vertex
    image = glass / (1.0 / image + (glass - 1.0) / -radius) - (outer - radius)
    image = WATER / (glass / image + (WATER - glass) / -outer)
    pixel = torch.tensor([[INTRINSICS.cx.value + 1.0, INTRINSICS.cy.value]], dtype=torch.float64)
    _, origins, directions, _ = seen(DOME, pixel, centre__z=-behind, outside_index=WATER)
    crossing = (
        origins[0, 2] - origins[0, 0] * directions[0, 2] / directions[0, 0]
    )  # where the ray seems to come from
    assert crossing == pytest.approx(outer - behind + image, rel=1e-5)


@pytest.mark.parametrize(
    ("example", "changed"),
    [
        (FLAT, {"tilt.x": -0.75, "tilt.y": 0.75}),
        (DOME, {"centre.y": -0.06, "centre.z": 0.0}),
        (CONE, {"axis_offset.z": 0.0, "radius_slope": 0.9}),
    ],
    ids=["parallel to the window", "from outside the dome", "on the axis of a steep cone"],
)
@pytest.mark.parametrize("exact_hit", [True, False])
def test_a_missed_cover_is_data_with_finite_gradients(
    example: Example, changed: dict[str, float], exact_hit: bool
) -> None:
    path, values = covered_path(INTRINSICS, example.changed(changed))
    path = with_relief(path, Relief(*example.patch, (3, 3)), exact_hit=exact_hit)
    values |= {"camera.fx": torch.tensor(300.0), "camera.fy": torch.tensor(300.0)}  # a wide view
    values["relief.amplitudes"] = torch.full((3, 3), 1e-5, dtype=torch.float64)
    values = {name: value.double().requires_grad_() for name, value in values.items()}
    columns, rows = torch.linspace(0, WIDTH - 1, 15), torch.linspace(0, HEIGHT - 1, 15)
    rays = path.trace(torch.cartesian_prod(columns, rows).double(), values, MIDDLE)
    assert MISSED_INNER in rays.failure.tolist()
    (rays.origin.stacked().sum() + rays.direction.stacked().sum()).backward()  # type: ignore[no-untyped-call]
    for param in path.params:
        slope = values[param.name].grad
        assert slope is not None
        assert torch.isfinite(slope).all(), param.name


@pytest.mark.parametrize("example", [CONE, CYLINDER, FLAT], ids=lambda example: example.cover.shape)
def test_a_tilt_is_left_out_only_where_it_is_zero_for_certain(example: Example) -> None:
    tilts = [f"tilt.{axis}" for axis in "xyz" if f"tilt.{axis}" in example.cover.parameters]
    path, _ = covered_path(INTRINSICS, example.cover)
    uncertain = Cover(
        example.cover.shape, {**example.cover.parameters, tilts[0]: Number(0.0, sigma=0.01)}
    )
    open_, _ = covered_path(INTRINSICS, uncertain)
    assert not {param.name for param in path.params} & {f"cover.{name}" for name in tilts}
    assert {f"cover.{name}" for name in tilts} <= {param.name for param in open_.params}


@each_shape
def test_an_outer_surface_inside_the_inner_one_is_missed(example: Example) -> None:
    """A fit may step there."""
    rays, *_ = seen(example, thickness=-0.001)
    assert set(rays.failure.tolist()) == {MISSED_OUTER}


def test_a_cylinder_is_a_cone_without_slope() -> None:
    cone = seen(CONE, inner_radius=0.042, radius_slope=0.0)
    cylinder = seen(CYLINDER, inner_radius=0.042)
    assert np.array_equal(cone[1], cylinder[1])
    assert np.array_equal(cone[2], cylinder[2])

"""Effects on the glass, each against an oracle that was built without it."""

from collections.abc import Mapping

import numpy as np
import pytest
import torch

from calib.effects.cover_offset import CoverOffset
from calib.effects.cover_radius import CoverRadius
from calib.effects.cover_tilt import CoverTilt
from calib.effects.effect import Effect, EffectContext, PlaceOnGlass
from calib.effects.fine_surface import FineSurface
from calib.effects.flat_port import WALL_INDEX, FlatPort
from calib.effects.inner_surface import InnerSurface
from calib.effects.refractive_index import RefractiveIndex
from calib.effects.thickness import Thickness
from calib.effects.wedge import Wedge
from calib.estimation.camera_model import CameraModel
from calib.estimation.priors import NONE
from calib.optics.build import covered_path, pinhole_path, with_relief
from calib.optics.exposure import MIDDLE
from calib.optics.relief import Relief
from calib.session.board import Board
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH
from tests.effects.rays import Array, Glass, Height, centres, pinhole, turned
from tests.optics import oracle
from tests.optics.shapes import CONE, CYLINDER, DOME, EXAMPLES, FLAT, Example, each_shape

PLACE = PlaceOnGlass((0.0, 0.0), (1.0, 1.0), 1e-3)
PIXELS = np.random.default_rng(0).uniform([0, 0], [WIDTH - 1, HEIGHT - 1], (16, 2))
GRID = (5, 6)
AMPLITUDES = np.random.default_rng(3).normal(0, 2e-5, GRID)
RISES = {
    "axis_offset.x": 1e-3,
    "axis_offset.z": -7e-4,
    "centre.x": 1e-3,
    "centre.y": -5e-4,
    "centre.z": 8e-4,
    "distance": -1e-3,
}


def model(example: Example) -> CameraModel:
    """Off-centre, tilted, under water and uneven outside."""
    path, values = covered_path(INTRINSICS, example.changed(example.moved))
    relief = Relief(*example.patch, GRID)
    return CameraModel(
        with_relief(path, relief),
        values | {"relief.amplitudes": torch.from_numpy(AMPLITUDES)},
        NONE,
    )


def proposed(kind: type[Effect], model: CameraModel, place: PlaceOnGlass | None = None) -> Effect:
    effect, *_ = kind.propose(
        EffectContext(Board(9, 9, 0.02), WIDTH, HEIGHT, model.path, model.means, place=place)
    )
    return effect


def parameters_of(example: Example, **changed: float) -> dict[str, float]:
    stated = {
        name: number.value for name, number in example.changed(example.moved).parameters.items()
    }
    return stated | {name: stated[name] + change for name, change in changed.items()}


def outer(example: Example) -> Height:
    at, widths = centres(*example.patch, GRID)
    return oracle.bumps(at, AMPLITUDES.ravel(), widths)


def agrees(
    effect: Effect,
    base: CameraModel,
    parameters: Mapping[str, float | Array],
    expected: tuple[Array, Array],
    *,
    moves: float,
) -> None:
    """The effect with its numbers gives the expected rays, and without it they are others."""
    wider = base.with_effect(effect)
    values = {
        name: torch.as_tensor(value, dtype=torch.float64) for name, value in parameters.items()
    }
    assert values.keys() <= wider.means.keys()
    pixels = torch.from_numpy(PIXELS)
    rays, reference_rays = (
        wider.path.trace(pixels, {**wider.means, **values}, MIDDLE),
        base.path.trace(pixels, base.means, MIDDLE),
    )
    assert not rays.failure.any()
    # The oracle's normals come from differences of step 1e-5 m: 1e-11 or so of rounding; the
    # bisection stops at 1e-17 m.
    assert np.abs(rays.origin.stacked().numpy() - expected[0]).max() < 1e-13
    assert np.abs(rays.direction.stacked().numpy() - expected[1]).max() < 1e-9
    depth = torch.tensor(1.0, dtype=torch.float64)
    assert (rays.at_depth(depth) - reference_rays.at_depth(depth)).norm(
        dim=-1
    ).max() > moves  # m, at 1 m


@each_shape
def test_cover_offset_is_a_camera_moved_the_other_way(example: Example) -> None:
    base = model(example)
    effect = proposed(CoverOffset, base)
    moved = {name: rise for name, rise in RISES.items() if name in example.cover.parameters}
    shift = np.zeros(3)
    for name, rise in moved.items():
        shift["xyz".index("z" if name == "distance" else name[-1])] = rise
    origins, directions = Glass(example, parameters_of(example), outer=outer(example)).rays(
        PIXELS, origin=-shift
    )
    moved_values = {f"cover_offset.{name}": rise for name, rise in moved.items()}
    assert moved_values.keys() == {u.param.name for u in effect.effect_parameters}
    agrees(effect, base, moved_values, (origins + shift, directions), moves=1e-5)


@pytest.mark.parametrize("example", [CONE, CYLINDER, FLAT], ids=lambda example: example.cover.shape)
def test_cover_tilt_is_a_camera_turned_the_other_way(example: Example) -> None:
    """Turned about the cover's origin, before the tilt that is stated."""
    base = model(example)
    effect = proposed(CoverTilt, base)
    axes = "xy" if example is FLAT else "xz"
    angles = dict(zip(axes, (0.02, -0.015), strict=True))
    parameters = parameters_of(example)
    stated = turned(**{axis: parameters.get(f"tilt.{axis}", 0.0) for axis in "xyz"})
    turn = stated @ turned(**angles) @ stated.T  # in the camera's axes
    middle = example.origin(parameters)
    origins, directions = Glass(example, parameters, outer=outer(example)).rays(
        PIXELS, origin=middle - turn.T @ middle, turn=turn.T
    )
    back = (origins - middle) @ turn.T + middle, directions @ turn.T
    agrees(
        effect,
        base,
        {f"cover_tilt.{axis}": angle for axis, angle in angles.items()},
        back,
        moves=1e-5,
    )


@pytest.mark.parametrize("example", [CONE, CYLINDER, FLAT], ids=lambda example: example.cover.shape)
def test_wedge_is_two_surfaces_each_turned_by_itself(example: Example) -> None:
    base = model(example)
    axes = "xy" if example is FLAT else "xz"
    angles = dict(zip(axes, (0.003, -0.005), strict=True))
    glass = Glass(
        example,
        parameters_of(example),
        outer=outer(example),
        wedge=(angles["x"], angles.get("y", 0.0), angles.get("z", 0.0)),
    )
    wedge_values = {f"wedge.{axis}": angle for axis, angle in angles.items()}
    agrees(proposed(Wedge, base), base, wedge_values, glass.rays(PIXELS), moves=1e-4)


def test_a_wedge_in_a_window_turns_light_towards_its_thick_side() -> None:
    """A thin prism of index n and angle a in air: (n - 1) a."""
    path, values = covered_path(INTRINSICS, FLAT.cover)
    base = CameraModel(path, values, NONE)
    wider = base.with_effect(proposed(Wedge, base))
    axis = torch.tensor([[INTRINSICS.cx.value, INTRINSICS.cy.value]], dtype=torch.float64)
    angle = 1e-3
    rays = wider.path.trace(
        axis, {**wider.means, "wedge.x": torch.tensor(angle, dtype=torch.float64)}, MIDDLE
    )
    assert float(rays.direction.y / rays.direction.z) == pytest.approx(
        0.5 * angle, rel=1e-5
    )  # +y is away, so thick


@pytest.mark.parametrize("example", [CONE, CYLINDER, DOME], ids=lambda example: example.cover.shape)
def test_cover_radius_is_another_cover(example: Example) -> None:
    base = model(example)
    rises = {"inner_radius": 6e-4} | ({"radius_slope": 0.012} if example is CONE else {})
    rise_values = {f"cover_radius.{name}": rise for name, rise in rises.items()}
    agrees(
        proposed(CoverRadius, base),
        base,
        rise_values,
        Glass(example, parameters_of(example, **rises), outer=outer(example)).rays(PIXELS),
        moves=1e-6,
    )


def test_a_cylinder_that_tapers_is_a_cone() -> None:
    path, values = covered_path(INTRINSICS, CYLINDER.cover)
    base = CameraModel(path, values, NONE)
    parameters = {name: number.value for name, number in CYLINDER.cover.parameters.items()} | {
        "radius_slope": -0.03
    }
    slope_values = {"cover_radius.radius_slope": -0.03}
    agrees(
        proposed(CoverRadius, base),
        base,
        slope_values,
        Glass(CONE, parameters).rays(PIXELS),
        moves=1e-5,
    )


@each_shape
@pytest.mark.parametrize(
    ("kind", "number", "rise"),
    [(Thickness, "thickness", -2e-4), (RefractiveIndex, "refractive_index", 0.02)],
)
def test_other_glass_is_another_cover(
    example: Example, kind: type[Effect], number: str, rise: float
) -> None:
    base = model(example)
    expected = Glass(example, parameters_of(example, **{number: rise}), outer=outer(example)).rays(
        PIXELS
    )
    agrees(proposed(kind, base), base, {f"{kind.name}.{number}": rise}, expected, moves=1e-6)


@each_shape
def test_inner_surface_is_a_sum_of_gaussians_on_the_inside(example: Example) -> None:
    base = model(example)
    effect = proposed(InnerSurface, base)
    amplitudes = np.random.default_rng(8).normal(0, 1e-5, (6, 6))
    at, widths = centres(*example.patch, (6, 6))
    glass = Glass(
        example,
        parameters_of(example),
        inner=oracle.bumps(at, amplitudes.ravel(), widths),
        outer=outer(example),
    )
    agrees(effect, base, {"inner_surface.amplitudes": amplitudes}, glass.rays(PIXELS), moves=1e-3)


@each_shape
def test_fine_surface_adds_narrower_gaussians_outside(example: Example) -> None:
    """Thirteen by thirteen, at a seventh of the spacing, around the place that asks for them."""
    base = model(example)
    low, high = example.patch
    place = np.array([0.6 * a + 0.4 * b for a, b in zip(low, high, strict=True)])
    effect = proposed(FineSurface, base, PlaceOnGlass((place[0], place[1]), (1.0, 1.0), 1e-3))
    steps = [(b - a) / (n - 1) / 7 for a, b, n in zip(low, high, GRID, strict=True)]
    at = np.array([place + np.array([i, j]) * steps for i in range(-6, 7) for j in range(-6, 7)])
    amplitudes = np.random.default_rng(9).normal(0, 5e-6, (13, 13))
    fine, coarse = oracle.bumps(at, amplitudes.ravel(), (steps[0], steps[1])), outer(example)
    glass = Glass(
        example,
        parameters_of(example),
        outer=lambda first, second: coarse(first, second) + fine(first, second),
    )
    agrees(effect, base, {"fine_surface.amplitudes": amplitudes}, glass.rays(PIXELS), moves=1e-4)


@pytest.mark.parametrize(("behind", "outside_index"), [("air", 1.0), ("water", 1.333)])
def test_flat_port_is_snell_through_parallel_plates(behind: str, outside_index: float) -> None:
    """In closed form: along the normal by distance over cosine in air, then in the wall; tangential
    sines keep their product.
    """
    path, values = pinhole_path(INTRINSICS)
    base = CameraModel(path, values, NONE)
    context = EffectContext(Board(9, 9, 0.02), WIDTH, HEIGHT, path, values)
    effects = [effect for effect in FlatPort.propose(context) if effect.behind == behind]
    (effect,) = effects
    distance, wall, tilt = 0.03 if behind == "water" else 0.0, 0.008, {"x": 0.05, "y": -0.08}
    normal = turned(**tilt)[:, 2]
    launched = pinhole(PIXELS)
    sideways = launched - (launched @ normal)[:, None] * normal
    in_wall, outgoing = sideways / WALL_INDEX, sideways / outside_index
    depth = distance * normal[2]  # the window passes the optical axis at its distance
    origins = depth * launched / (launched @ normal)[:, None] + wall * (
        in_wall / np.sqrt(1 - (in_wall**2).sum(-1, keepdims=True)) + normal
    )
    directions = outgoing + np.sqrt(1 - (outgoing**2).sum(-1, keepdims=True)) * normal
    port_values = {"thickness": wall, **{f"tilt.{axis}": angle for axis, angle in tilt.items()}}
    if behind == "water":
        port_values |= {"outside_index": outside_index, "distance": distance}
    agrees(
        effect,
        base,
        {f"flat_port.{name}": value for name, value in port_values.items()},
        (origins, directions),
        moves=1e-4,
    )


def test_impossible_effects_are_not_proposed() -> None:
    covers: tuple[type[Effect], ...] = (
        CoverTilt,
        CoverOffset,
        CoverRadius,
        Thickness,
        RefractiveIndex,
        Wedge,
        InnerSurface,
        FineSurface,
    )
    path, values = pinhole_path(INTRINSICS)
    bare = EffectContext(Board(9, 9, 0.02), WIDTH, HEIGHT, path, values, place=PLACE)
    assert not [effect for kind in covers for effect in kind.propose(bare)]
    for example in EXAMPLES:
        path, values = covered_path(INTRINSICS, example.cover)
        smooth = EffectContext(Board(9, 9, 0.02), WIDTH, HEIGHT, path, values, place=PLACE)
        kinds: tuple[type[Effect], ...] = (FlatPort, InnerSurface)
        assert not [effect for kind in kinds for effect in kind.propose(smooth)]
        assert [effect.form for effect in FineSurface.propose(smooth)] == ["bump"]
        if example is DOME:  # turned, it is the same dome
            assert not [effect for kind in (CoverTilt, Wedge) for effect in kind.propose(smooth)]
        if example is FLAT:
            assert not CoverRadius.propose(smooth)

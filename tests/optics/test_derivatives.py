"""The derivatives of the ray path in closed form are those of torch."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from calib.optics.derivatives import ByRay
from calib.optics.exposure import MIDDLE
from calib.optics.lens import PIXELS, PUPIL
from calib.optics.lens_model import COEFFICIENTS, LensModel
from calib.optics.path import Path
from calib.optics.relief import AMPLITUDES, PROBES, Bump, Relief
from calib.optics.vector import Vector
from calib.session.parameter_names import CAMERA
from tests.optics.oracle import row_derivatives
from tests.optics.shapes import Example, each_shape
from tests.optics.test_path import nominal, some_pixels

ROWS = 12
TOLERANCE = 1e-9
"""Of the largest derivative by the same number: rounding, behind Newton steps that end at 1e-14."""


def by_torch(path: Path, values: dict[str, Tensor], pixels: Tensor) -> dict[str, Tensor]:
    """The derivatives of the rays that leave the cover, (6, M, ...) by name."""
    leaves = {
        name: value.expand(ROWS, *value.shape).clone().requires_grad_()
        for name, value in values.items()
    }
    leaves[PIXELS] = pixels.clone().requires_grad_()
    rays = path.trace(leaves[PIXELS], leaves, MIDDLE)
    at = torch.cat([rays.origin.stacked(), rays.direction.stacked()], -1)
    rows = row_derivatives(at, [*leaves.values()])
    return {name: row.transpose(0, 1) for name, row in zip(leaves, rows, strict=True)}


def in_closed_form(path: Path, values: dict[str, Tensor], pixels: Tensor) -> dict[str, Tensor]:
    trace = path.trace_with_derivatives(pixels, values, MIDDLE, frozenset(values))
    each = torch.eye(6).double().unsqueeze(-1).expand(6, 6, ROWS).unbind(1)
    by = trace.pull(ByRay(Vector(*each[:3]), Vector(*each[3:])))
    if path.relief and AMPLITUDES in values:
        assert trace.relief_chart
        columns = pixels.new_empty(ROWS, 6, values[AMPLITUDES].numel())
        path.relief.spread(
            torch.stack(
                [f * by[n] for n, f in zip(PROBES, trace.relief_factors, strict=True)], -1
            ).transpose(0, 1),
            trace.relief_chart,
            columns,
        )
        by[AMPLITUDES] = columns.transpose(0, 1)
    return by


def compare(path: Path, values: dict[str, Tensor], pixels: Tensor) -> None:
    expected, result = by_torch(path, values, pixels), in_closed_form(path, values, pixels)
    for name in (*(param.name for param in path.params), PIXELS):
        wanted = expected[name].flatten(2) if expected[name].ndim > 2 else expected[name]
        assert wanted.abs().max() > 0, f"{name} moves no ray"
        worst = float((result[name].reshape(wanted.shape) - wanted).abs().max())
        assert worst < TOLERANCE * float(wanted.abs().max()), name


@each_shape
@pytest.mark.parametrize(
    "kind", ["even", "relief", "anchored", "grown", "tilts only", "inner", "bump", "grown bump"]
)
def test_those_of_a_cover(example: Example, kind: str) -> None:
    path, values = nominal(example, changed=example.moved)
    *inner, outer = path.cover
    relief = outer.relief
    assert relief
    low, high = relief.low, relief.high
    rng = np.random.default_rng(8)
    if kind == "even":
        outer = replace(outer, relief=None)
        del values[AMPLITUDES]
    if kind in ("anchored", "grown", "grown bump"):
        view = outer.relief_view(values)
        first, second = view.anchor
        size = (0.9 * view.size[0], 1.05 * view.size[1], 1.1 * view.size[2])
        anchor = first + 1e-3, second + 1e-3
        tied = replace(relief, anchor=anchor, size=None if kind == "anchored" else size)
        outer = replace(outer, relief=tied)
    if kind == "tilts only":
        outer = replace(outer, exact_hit=False)
    if kind == "inner":
        inner[0] = replace(inner[0], relief=Relief(low, high, (4, 5), name="inner"))
        values["inner.amplitudes"] = torch.from_numpy(rng.normal(0, 1e-5, (4, 5)))
    if kind in ("bump", "grown bump"):
        middle = (low[0] + high[0]) / 2, (low[1] + high[1]) / 2
        span = high[0] - low[0], high[1] - low[1]
        bump = Bump("bump", middle, (0.03 / span[0], 0.03 / span[1]))
        outer = replace(outer, extra_reliefs=(bump,))
        values |= {
            f"bump.{name}": torch.tensor(value, dtype=torch.float64)
            for name, value in {
                "height": 2e-5,
                "first": 1e-3,
                "second": 2e-3,
                "width": 8e-3,
            }.items()
        }
    compare(replace(path, cover=(*inner, outer)), values, some_pixels(ROWS))


@each_shape
@pytest.mark.parametrize("count", [ROWS, 1, 0])
def test_one_number_may_differ_from_ray_to_ray(example: Example, count: int) -> None:
    """An effect gives each row its own value of a number, and a relief follows the cover."""
    path, nominal_values = nominal(example, changed=example.moved)
    *inner, outer = path.cover
    assert outer.relief
    view = outer.relief_view(nominal_values)
    anchor = view.anchor[0] + 1e-3, view.anchor[1] + 1e-3
    tied = replace(outer.relief, anchor=anchor, size=view.size)
    outer = replace(outer, relief=tied)
    path, pixels = replace(path, cover=(*inner, outer)), some_pixels(count)
    names = frozenset(nominal_values)
    for name in (param.name for stage in path.cover for param in stage.params):
        if nominal_values[name].ndim:
            continue
        values = {**nominal_values, name: nominal_values[name].expand(count)}
        each = torch.ones(2, count, dtype=torch.float64)
        by_rays = ByRay(Vector(each, each, each), Vector(each, each, each))
        result = path.trace_with_derivatives(pixels, values, MIDDLE, names).pull(by_rays)
        wanted = path.trace_with_derivatives(pixels, nominal_values, MIDDLE, names).pull(by_rays)
        for key, expected in wanted.items():
            scale = float(expected.abs().max()) if count else 0.0
            difference = (result[key] - expected).abs().sum()
            assert float(difference) <= TOLERANCE * scale, (name, key)


@each_shape
def test_of_a_cover_that_hardly_bends(example: Example) -> None:
    """Equal indices on both sides, and glass without thickness."""
    for changed in (
        {"refractive_index": 1.0, "outside_index": 1.0},
        {"refractive_index": 1.333, "outside_index": 1.333},
        {"thickness": 0.0},
    ):
        path, values = nominal(example, changed=changed)
        compare(path, values, some_pixels(ROWS))


@pytest.mark.parametrize("count", [0, 4, 5, 8, 12, 14])
@pytest.mark.parametrize("pupil", [False, True])
def test_those_of_a_lens(count: int, pupil: bool) -> None:
    path = Path(LensModel(count, PUPIL if pupil else ()))
    numbers = {CAMERA.fx: 3e3, CAMERA.fy: 3.1e3, CAMERA.cx: 1600.0, CAMERA.cy: 1200.0}
    sizes = (0.1, -0.05, 1e-3, -2e-3, 0.02, 0.03, 0.01, -0.01, 1e-3, 2e-3, -1e-3, 1e-3, 0.01, 0.02)
    numbers |= {
        CAMERA.of(name): size for name, size in zip(COEFFICIENTS[:count], sizes, strict=False)
    }
    numbers |= {param.name: 1e-3 for param in PUPIL} if pupil else {}
    values = {name: torch.tensor(value, dtype=torch.float64) for name, value in numbers.items()}
    compare(path, values, some_pixels(ROWS))


@each_shape
def test_a_ray_that_fails_has_finite_derivatives(example: Example) -> None:
    path, values = nominal(example, amplitude=3e-3, changed={"refractive_index": 2.6})
    pixels = some_pixels(ROWS * 50)
    trace = path.trace_with_derivatives(pixels, values, MIDDLE, frozenset(values))
    each = torch.ones(1, len(pixels), dtype=torch.float64)
    by = trace.pull(ByRay(Vector(each, each, each), Vector(each, each, each)))
    assert all(bool(torch.isfinite(value).all()) for value in by.values())

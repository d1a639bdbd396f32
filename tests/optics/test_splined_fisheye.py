"""The splined lens: its surface against scipy's splines, and its way there and back."""

import numpy as np
import torch
from scipy.interpolate import NdBSpline

from calib.optics.exposure import MIDDLE
from calib.optics.fisheye import Fisheye
from calib.optics.path import Path
from calib.optics.projection import project
from calib.optics.splined_fisheye import (
    CORRELATION_LENGTH,
    PRIOR_SCALE,
    ROUGHNESS,
    SHIFTS,
    Grid,
    SplinedFisheye,
)
from tests.optics.test_fisheye import around, values

SIZE_PX = (800, 620)
COLUMNS, ROWS = 8, 6
COUNT = COLUMNS * ROWS
LENS = SplinedFisheye(Grid(SIZE_PX, (COLUMNS, ROWS)))


def uneven(size: float = 2.0) -> dict[str, torch.Tensor]:
    shifts = torch.from_numpy(np.random.default_rng(1).normal(0, size, (2, COUNT)))
    return values() | dict(zip(SHIFTS, shifts, strict=True))


def inside(count: int = 300) -> torch.Tensor:
    return torch.from_numpy(
        np.random.default_rng(0).uniform(-0.5, np.array(SIZE_PX) - 0.5, (count, 2))
    )


def test_its_surface_is_scipy_s_bicubic_spline() -> None:
    """Control points stand at the picture's border, one spacing apart, and one beyond it on every
    side.
    """
    at, numbers = inside(), uneven()
    spacing = [SIZE_PX[0] / (COLUMNS - 3), SIZE_PX[1] / (ROWS - 3)]
    knots = [
        step * np.arange(-3, count + 1.0) - 0.5
        for step, count in zip(spacing, (COLUMNS, ROWS), strict=True)
    ]
    for name in SHIFTS:
        surface = NdBSpline((knots[1], knots[0]), numbers[name].numpy().reshape(ROWS, COLUMNS), 3)
        ours = (LENS.grid.basis(at) * numbers[name]).sum(-1)
        assert (
            np.abs(ours.numpy() - surface(np.ascontiguousarray(at.numpy()[:, ::-1]))).max() < 1e-12
        )


def test_weights_sum_to_one_everywhere_and_stay_beyond_the_border() -> None:
    outside_pixels = torch.tensor([[-200.0, 100.0], [900.0, 700.0]], dtype=torch.float64)
    at_border = torch.tensor([[-0.5, 100.0], [799.5, 619.5]], dtype=torch.float64)
    assert (LENS.grid.basis(inside()).sum(-1) - 1).abs().max() < 1e-12
    assert torch.equal(LENS.grid.basis(outside_pixels), LENS.grid.basis(at_border))


def test_without_shifts_it_is_the_fisheye() -> None:
    flat = uneven(0.0)
    assert torch.equal(
        LENS(inside(), flat).direction.stacked(), Fisheye()(inside(), values()).direction.stacked()
    )


def test_there_and_back_beside_and_behind_the_pinhole() -> None:
    for degrees in (0.0, 30.0, 80.0, 90.0, 120.0):
        directions = around(degrees)
        pixels = LENS.project(directions, uneven())
        assert (LENS(pixels, uneven()).direction.stacked() - directions).abs().max() < 1e-12
        assert torch.isfinite(project(Path(LENS), uneven(), directions, MIDDLE)).all()


def test_derivatives_by_the_control_points_agree_with_central_differences() -> None:
    pixels = inside(5)
    for name in SHIFTS:
        leaf = uneven()[name].requires_grad_()
        rows = LENS(pixels, {**uneven(), name: leaf}).direction.stacked().reshape(-1)
        analytic = torch.stack(
            [torch.autograd.grad(row, leaf, retain_graph=True)[0] for row in rows]
        )
        steps = 1e-3 * torch.eye(COUNT, dtype=torch.float64)
        ends = [
            [
                LENS(pixels, {**uneven(), name: leaf.detach() + s * d})
                .direction.stacked()
                .reshape(-1)
                for d in steps
            ]
            for s in (1, -1)
        ]
        numeric = (torch.stack(ends[0], -1) - torch.stack(ends[1], -1)) / 2e-3
        assert (analytic - numeric).abs().max() < 1e-6 * numeric.abs().max()


def test_each_pixel_can_have_a_surface_of_its_own() -> None:
    """The derivatives by row need this."""
    pixels, item, two = inside(2), uneven(), uneven(1.0)
    mixed = {name: torch.stack([item[name], two[name]]) for name in item}
    alone = torch.cat(
        [LENS(pixels[i : i + 1], row).direction.stacked() for i, row in enumerate((item, two))]
    )
    assert torch.allclose(LENS(pixels, mixed).direction.stacked(), alone, rtol=0, atol=1e-12)


def test_its_prior_is_a_smooth_field() -> None:
    """Neighbours along x are correlated by exp(-1 / (2 reach^2)), and what is far apart is not."""
    root = LENS.grid.prior_root()
    covariance = root @ root.T / (PRIOR_SCALE * max(SIZE_PX)) ** 2
    assert np.allclose(covariance.diagonal(), 1 + ROUGHNESS**2)
    assert np.isclose(covariance[0, 1], np.exp(-1 / (2 * CORRELATION_LENGTH**2)))
    assert np.isclose(covariance[0, COLUMNS], np.exp(-1 / (2 * CORRELATION_LENGTH**2)))
    assert covariance[0, -1] < 1e-6

"""The fisheye lens against OpenCV's, and against its own formula where OpenCV's ends."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
import torch

from calib.optics.exposure import MIDDLE, Exposure
from calib.optics.fisheye import Fisheye
from calib.optics.lens import PUPIL, PUPIL_LATERAL
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.optics.projection import project
from calib.optics.rays import LENS

COEFFICIENTS = (-0.02, 0.01, -0.004, 8e-4)
PINHOLE = {"fx": 300.0, "fy": 305.0, "cx": 400.0, "cy": 310.0}


def values(coefficients: tuple[float, ...] = COEFFICIENTS) -> dict[str, torch.Tensor]:
    numbers = PINHOLE | {f"kb{order}": value for order, value in enumerate(coefficients, 1)}
    lens = {
        f"camera.{name}": torch.tensor(value, dtype=torch.float64)
        for name, value in numbers.items()
    }
    pupil = {"e2": 2e-3, "e4": -1e-4, "x2": 3e-4, "y2": -2e-4}
    return lens | {
        f"entrance_pupil.{name}": torch.tensor(value, dtype=torch.float64)
        for name, value in pupil.items()
    }


def around(degrees: float, count: int = 36) -> torch.Tensor:
    """(count, 3) unit directions at an angle from the axis."""
    turn = torch.linspace(0, 2 * math.pi, count, dtype=torch.float64)
    angle = torch.tensor(math.radians(degrees), dtype=torch.float64)
    return torch.stack(
        [angle.sin() * turn.cos(), angle.sin() * turn.sin(), angle.cos().expand(count)], -1
    )


def test_the_fisheye_agrees_with_opencv() -> None:
    """Up to 85 degrees from the axis."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-8, 8, (400, 2)), np.ones(400)])
    matrix = np.array(
        [[PINHOLE["fx"], 0, PINHOLE["cx"]], [0, PINHOLE["fy"], PINHOLE["cy"]], [0, 0, 1]]
    )
    pixels = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), matrix, np.array(COEFFICIENTS)
    )[0].reshape(-1, 2)
    assert (
        np.abs(Fisheye().project(torch.from_numpy(points), values()).numpy() - pixels).max() < 1e-9
    )
    rays = Fisheye()(torch.from_numpy(pixels), values())
    assert not rays.failure.any()
    assert (
        np.abs(
            rays.direction.stacked().numpy()
            - points / np.linalg.norm(points, axis=-1, keepdims=True)
        ).max()
        < 1e-12
    )


@pytest.mark.parametrize("degrees", [0.0, 1e-7, 30, 89.9999, 90, 120, 170])
def test_the_fisheye_sees_beside_and_behind_itself(degrees: float) -> None:
    """A ray's distance from the principal point is that of the polynomial, also through a path's
    projection and back.
    """
    directions = around(degrees)
    pixels = Fisheye().project(directions, values())
    angle = math.radians(degrees)
    distance = angle * (
        1 + sum(k * angle ** (2 * order) for order, k in enumerate(COEFFICIENTS, 1))
    )
    error = (pixels.numpy() - [PINHOLE["cx"], PINHOLE["cy"]]) / [PINHOLE["fx"], PINHOLE["fy"]]
    assert np.abs(np.linalg.norm(error, axis=-1) - distance).max() < 1e-12
    rays = Fisheye()(pixels, values())
    assert not rays.failure.any()
    assert (rays.direction.stacked() - directions).abs().max() < 1e-12
    assert torch.equal(
        project(Path(Fisheye()), values(), 0.7 * directions, MIDDLE),
        Fisheye().project(0.7 * directions, values()),
    )


@dataclass(frozen=True)
class Shift:
    """An adjustment by 0.3 px: every pixel lies too far to the right."""

    params: tuple[Param, ...] = ()

    def __call__(
        self, pixels: torch.Tensor, values: Values, _exposure: Exposure | None, /
    ) -> tuple[torch.Tensor, Values]:
        return pixels - torch.tensor([0.3, 0.0], dtype=pixels.dtype), values


@pytest.mark.parametrize("degrees", [0.5, 60, 89.9999, 90, 91, 120, 150])
@pytest.mark.parametrize(
    "path",
    [
        Path(Fisheye(pupil=PUPIL + PUPIL_LATERAL)),
        Path(Fisheye(), adjustments=(Shift(),)),
        Path(Fisheye(pupil=PUPIL), adjustments=(Shift(),)),
    ],
    ids=["pupil", "adjustment", "both"],
)
def test_points_on_rays_are_projected_back(path: Path, degrees: float) -> None:
    """Points beside and behind the camera are projected back even with effects, from any start
    nearby.
    """
    pixels = Fisheye().project(around(degrees), values())
    rays = path.trace(pixels, values(), MIDDLE)
    points = (rays.origin + rays.direction * torch.tensor(0.4, dtype=torch.float64)).stacked()
    for start in (None, pixels + 3.0):
        result = project(path, values(), points, MIDDLE, start)
        assert (result - pixels).abs().max() < 1e-6


def test_a_point_on_the_other_side_is_not_seen() -> None:
    """The line of a ray continues behind its origin, where the ray sees nothing."""
    path = Path(Fisheye(), adjustments=(Shift(),))
    pixels = Fisheye().project(around(60), values())
    result = project(path, values(), -around(60), MIDDLE, start=pixels)
    assert (torch.isnan(result).all(-1) | ((result - pixels).norm(dim=-1) > 100)).all()


def test_the_fisheye_fails_beyond_the_fold_and_stays_finite() -> None:
    """theta (1 - theta^2 / 4) never exceeds 0.77, at 66 degrees; what is seen at a larger angle is
    imaged where a smaller one is.
    """
    folded = values((-0.25, 0.0, 0.0, 0.0))
    folded["camera.kb1"].requires_grad_()
    rays = Fisheye()(
        torch.tensor(
            [[PINHOLE["cx"] + 240.0, PINHOLE["cy"]], [PINHOLE["cx"] + 220.0, PINHOLE["cy"]]]
        ).double(),
        folded,
    )
    rays.direction.stacked().sum().backward()  # type: ignore[no-untyped-call]
    assert rays.failure.tolist() == [LENS, 0]
    assert torch.isfinite(rays.direction.stacked()).all()
    gradient = folded["camera.kb1"].grad
    assert gradient is not None
    assert torch.isfinite(gradient)
    fixed = {name: value.detach() for name, value in folded.items()}
    assert torch.isnan(project(Path(Fisheye()), fixed, around(70), MIDDLE)).all()
    assert torch.isfinite(project(Path(Fisheye()), fixed, around(60), MIDDLE)).all()


def test_a_second_branch_is_no_ray() -> None:
    """A polynomial that falls and rises again reaches the same distance three times; only the first
    is the lens's.
    """
    wavy = values((-0.6, 0.16, 0.0, 0.0))
    rays = Fisheye()(
        torch.tensor([[PINHOLE["cx"] + 300 * 0.9, PINHOLE["cy"]]], dtype=torch.float64), wavy
    )
    assert rays.failure.tolist() == [LENS]


def test_derivatives_agree_with_central_differences() -> None:
    lens = Fisheye(pupil=PUPIL + PUPIL_LATERAL)
    pixels = torch.tensor(
        [[100.0, 700.0], [420.0, 305.0], [1000.0, 100.0]], dtype=torch.float64
    )  # 40, 4 and 120 degrees off the axis

    def launched(at: Values) -> torch.Tensor:
        rays = lens(pixels, at)
        assert not rays.failure.any()
        return torch.cat([rays.origin.stacked(), rays.direction.stacked()], -1).reshape(-1)

    for param in lens.params:
        point = values()[param.name].requires_grad_()
        rows = launched({**values(), param.name: point})
        analytic = torch.stack(
            [
                torch.autograd.grad(row, point, retain_graph=True, materialize_grads=True)[0]
                for row in rows
            ]
        )
        size = (
            1e-4 * param.scale
        )  # kb4 weighs the angle to the ninth power: longer steps show the third derivative
        forward = launched({**values(), param.name: point.detach() + size})
        backward = launched({**values(), param.name: point.detach() - size})
        numeric = (forward - backward) / (2 * size)
        assert numeric.abs().max() > 0
        assert (analytic - numeric).abs().max() < 1e-6 * numeric.abs().max(), param.name


@pytest.mark.parametrize("degrees", [0.0, 30.0, 110.0])
def test_rays_begin_where_the_pupil_stands_at_their_angle(degrees: float) -> None:
    """On the axis for a centred lens, and as far to one side, whatever their direction around the
    axis, for a decentred one.
    """
    pixels = Fisheye().project(around(degrees), values())
    angle = math.radians(degrees)
    distance = 2e-3 * angle**2 - 1e-4 * angle**4
    for pupil, aside in ((PUPIL, (0.0, 0.0)), (PUPIL + PUPIL_LATERAL, (3e-4, -2e-4))):
        origin = Fisheye(pupil)(pixels, values()).origin.stacked().numpy()
        assert np.abs(origin - [aside[0] * angle**2, aside[1] * angle**2, distance]).max() < 1e-14
    assert not Fisheye()(pixels, values()).origin.stacked().any()


def test_projection_and_rays_have_inverse_derivatives() -> None:
    """The projection's derivative, against central differences in space."""
    points = around(100, 5) * 0.4
    at = points.clone().requires_grad_()
    visible = Fisheye().project(at, values())
    analytic = torch.stack(
        [torch.autograd.grad(visible[:, i].sum(), at, retain_graph=True)[0] for i in (0, 1)], 1
    )
    for axis in range(3):
        step = 1e-5 * torch.eye(3, dtype=torch.float64)[axis]
        numeric = (
            Fisheye().project(points + step, values()) - Fisheye().project(points - step, values())
        ) / 2e-5
        assert (analytic[..., axis] - numeric).abs().max() < 1e-6 * analytic.abs().max()


def test_each_pixel_can_have_a_lens_of_its_own() -> None:
    """The derivatives by row need this."""
    pixels = torch.tensor([[100.0, 80.0], [600.0, 700.0], [420.0, 200.0]], dtype=torch.float64)
    alternative = {name: 1.1 * value for name, value in values().items()}
    mixed = {
        name: torch.stack([value, alternative[name], value]) for name, value in values().items()
    }
    together = Fisheye()(pixels, mixed).direction.stacked()
    alone = torch.cat(
        [
            Fisheye()(pixels[i : i + 1], row).direction.stacked()
            for i, row in enumerate((values(), alternative, values()))
        ]
    )
    assert torch.allclose(together, alone, rtol=0, atol=1e-12)

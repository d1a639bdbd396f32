"""LensModel, Snell's law, rotations, relief and board, each against an oracle built another way."""

import cv2
import numpy as np
import pytest
import torch

from calib.optics import rotation
from calib.optics.board_target import Target
from calib.optics.lens_model import COEFFICIENTS, LensModel
from calib.optics.placement import Placement
from calib.optics.rays import LENS, Rays
from calib.optics.relief import Relief
from calib.optics.snell import Refraction
from calib.optics.vector import Vector
from calib.session.lens import COEFFICIENTS as ACCEPTED_COUNTS
from tests.optics import oracle

LENS_NUMBERS = (
    -0.28,
    0.11,
    8e-4,
    -5e-4,
    -0.02,
    0.05,
    -0.03,
    0.01,
    1e-3,
    -2e-4,
    7e-4,
    3e-4,
    0.02,
    -0.03,
)
PINHOLE = {"fx": 1279.18, "fy": 1270.0, "cx": 832.765, "cy": 636.575}


def lens_values(
    count: int, parameters: tuple[float, ...] = LENS_NUMBERS
) -> dict[str, torch.Tensor]:
    keywords = {**PINHOLE, **dict(zip(COEFFICIENTS[:count], parameters, strict=False))}
    return {
        f"camera.{name}": torch.tensor(value, dtype=torch.float64)
        for name, value in keywords.items()
    }


@pytest.mark.parametrize("count", ACCEPTED_COUNTS)
def test_lens_undoes_what_opencv_projects(count: int) -> None:
    rng = np.random.default_rng(count)
    points = np.column_stack(
        [rng.uniform(-0.65, 0.65, 400), rng.uniform(-0.5, 0.5, 400), np.ones(400)]
    )
    camera = np.array(
        [[PINHOLE["fx"], 0, PINHOLE["cx"]], [0, PINHOLE["fy"], PINHOLE["cy"]], [0, 0, 1]]
    )
    pixels = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), camera, np.array(LENS_NUMBERS[:count])
    )[0].reshape(-1, 2)
    lens, values = LensModel(count), lens_values(count)
    rays = lens(torch.from_numpy(pixels), values)
    back = (rays.direction.stacked() / rays.direction.z.unsqueeze(-1)).numpy()
    assert not rays.failure.any()
    assert np.abs(back - points).max() < 1e-9
    assert np.abs(lens.project(torch.from_numpy(points), values).numpy() - pixels).max() < 1e-9


def test_lens_finds_the_same_rays_from_a_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """From near by, in fewer steps, and from where no start is known."""
    count = 8
    pixels = torch.from_numpy(np.random.default_rng(0).uniform((0, 0), (1600, 1200), (200, 2)))
    result = LensModel(count)(pixels, lens_values(count)).direction
    near = torch.stack([result.x, result.y], -1) / result.z[:, None] + 1e-3
    near[::7] = torch.nan
    with_start = LensModel(count)(pixels, lens_values(count), near).direction
    assert float((with_start.stacked() - result.stacked()).abs().max()) < 1e-12
    monkeypatch.setattr("calib.optics.lens_model.NEWTON_STEPS", 2)
    failures = [
        LensModel(count)(pixels, lens_values(count), start).failure != 0 for start in (None, near)
    ]
    assert int(failures[0].sum()) > 100, "the control: from the pixel, two steps are too few"
    assert not failures[1][near.isfinite().all(1)].any()


def test_lens_fails_beyond_the_fold_and_stays_finite() -> None:
    values = lens_values(4, (-0.5, 0.0, 0.0, 0.0))  # r (1 - r^2 / 2) never exceeds 0.544
    values["camera.k1"].requires_grad_()
    rays = LensModel(4)(
        torch.tensor(
            [[PINHOLE["cx"] + 900.0, PINHOLE["cy"]], [PINHOLE["cx"], PINHOLE["cy"]]],
            dtype=torch.float64,
        ),
        values,
    )
    rays.direction.stacked().sum().backward()  # type: ignore[no-untyped-call]
    assert rays.failure.tolist() == [LENS, 0]
    assert torch.isfinite(rays.direction.stacked()).all()
    slope = values["camera.k1"].grad
    assert slope is not None
    assert torch.isfinite(slope)


def test_lens_derivatives_agree_with_central_differences() -> None:
    values = lens_values(14)
    pixels = torch.tensor([[300.0, 900.0], [1500.0, 100.0]], dtype=torch.float64)
    for param in LensModel(14).params:
        value = values[param.name].clone().requires_grad_()
        rows = LensModel(14)(pixels, {**values, param.name: value}).direction.stacked().reshape(-1)
        analytic = torch.stack(
            [torch.autograd.grad(row, value, retain_graph=True)[0] for row in rows]
        )
        size = 1e-3 * param.scale
        forward = (
            LensModel(14)(pixels, {**values, param.name: value.detach() + size})
            .direction.stacked()
            .reshape(-1)
        )
        backward = (
            LensModel(14)(pixels, {**values, param.name: value.detach() - size})
            .direction.stacked()
            .reshape(-1)
        )
        numeric = (forward - backward) / (2 * size)
        assert (analytic - numeric).abs().max() < 1e-6 * numeric.abs().max(), param.name


def test_each_pixel_can_have_a_lens_of_its_own() -> None:
    """The derivatives by row need this."""
    pixels = torch.tensor([[100.0, 80.0], [900.0, 700.0], [1500.0, 200.0]], dtype=torch.float64)
    values = lens_values(14)
    other_values = {name: 1.1 * value for name, value in values.items()}
    mixed = {
        name: torch.stack([value, other_values[name], value]) for name, value in values.items()
    }
    together = LensModel(14)(pixels, mixed).direction.stacked()
    alone = torch.cat(
        [
            LensModel(14)(pixels[i : i + 1], lens_values_of_row).direction.stacked()
            for i, lens_values_of_row in enumerate((values, other_values, values))
        ]
    )
    assert torch.allclose(together, alone, rtol=0, atol=1e-12)


def test_rotation_is_opencv_s() -> None:
    for rotvec in ([0.3, -1.2, 2.0], [1e-5, 2e-5, -1e-5], [0.0, 0.0, 0.0], [0.0, np.pi, 0.0]):
        ours = rotation.matrix(torch.tensor(rotvec, dtype=torch.float64)).numpy()
        assert np.abs(ours - cv2.Rodrigues(np.array(rotvec))[0]).max() < 1e-14


@pytest.mark.parametrize(
    "rotvec", [[0.3, -1.2, 2.0], [3e-4, 2e-4, -1e-4], [2e-3, 0.0, 1e-3], [0.0, 0.0, 0.0]]
)
def test_rotation_derivatives_agree_with_central_differences(rotvec: list[float]) -> None:
    vector = torch.tensor(rotvec, dtype=torch.float64)
    derivatives = rotation.derivatives(vector, rotation.matrix(vector))
    for axis, step in enumerate(1e-6 * torch.eye(3, dtype=torch.float64)):
        numeric = (rotation.matrix(vector + step) - rotation.matrix(vector - step)) / 2e-6
        assert (derivatives[axis] - numeric).abs().max() < 1e-9


@pytest.mark.parametrize("angle", [0.0, 1e-8])
def test_rotation_is_smooth_at_zero(angle: float) -> None:
    rotvec = torch.tensor([angle, 0.0, 0.0], dtype=torch.float64, requires_grad=True)
    rotation.matrix(rotvec)[2, 1].backward()  # type: ignore[no-untyped-call]
    assert rotvec.grad is not None
    assert rotvec.grad.tolist() == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize(("n_from", "n_to"), [(1.0, 1.5), (1.5, 1.0), (1.5, 1.333), (1.0, 1.0)])
def test_refraction_is_snell_s_law_by_angles(n_from: float, n_to: float) -> None:
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(100, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    directions = normals + rng.uniform(-0.35, 0.35, (100, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ratio = torch.tensor(n_from / n_to, dtype=torch.float64)
    refraction = Refraction.of(
        Vector.of(torch.from_numpy(directions)), Vector.of(torch.from_numpy(normals)), ratio
    )
    expected = np.array(
        [oracle.bend(d, n, n_from, n_to) for d, n in zip(directions, normals, strict=True)]
    )
    assert not refraction.reflected.any()
    assert np.abs(refraction.bent.stacked().numpy() - expected).max() < 1e-13


def test_total_reflection_keeps_the_direction_and_finite_gradients() -> None:
    steep = Vector.of(torch.tensor([[0.9, 0.0, 0.19**0.5]], dtype=torch.float64))
    normal = Vector.of(torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64))
    ratio = torch.tensor(1.5, dtype=torch.float64, requires_grad=True)
    refraction = Refraction.of(steep, normal, ratio)
    bent = refraction.bent.stacked()
    bent.sum().backward()  # type: ignore[no-untyped-call]
    assert refraction.reflected.tolist() == [True]
    assert torch.equal(bent.detach(), steep.stacked())
    assert ratio.grad is not None
    assert torch.isfinite(ratio.grad)


def test_relief_is_the_paper_s_sum_of_gaussians() -> None:
    relief = Relief((-0.01, -0.26), (0.01, 0.26), (4, 7))
    rng = np.random.default_rng(5)
    amplitudes = rng.normal(0, 1e-5, (4, 7))
    rows, columns = np.linspace(-0.01, 0.01, 4), np.linspace(-0.26, 0.26, 7)
    centres = np.array([(y, theta) for y in rows for theta in columns])
    plain = oracle.bumps(centres, amplitudes.ravel(), (rows[1] - rows[0], columns[1] - columns[0]))
    values = {"relief.amplitudes": torch.from_numpy(amplitudes)}
    for y, theta in rng.uniform([-0.012, -0.3], [0.012, 0.3], (20, 2)):
        at = torch.tensor(y, dtype=torch.float64), torch.tensor(theta, dtype=torch.float64)
        height, by_y, by_theta = relief.height(at, values)
        assert float(height) == pytest.approx(plain(y, theta), abs=1e-18)
        assert float(by_y) == pytest.approx(
            (plain(y + 1e-6, theta) - plain(y - 1e-6, theta)) / 2e-6, rel=1e-6, abs=1e-9
        )
        assert float(by_theta) == pytest.approx(
            (plain(y, theta + 1e-5) - plain(y, theta - 1e-5)) / 2e-5, rel=1e-6, abs=1e-10
        )


def test_board_is_hit_where_opencv_s_homography_says() -> None:
    rng = np.random.default_rng(2)
    pose = np.array([0.4, -0.5, 0.2, 0.05, -0.03, 0.6])
    corners = rng.uniform(-0.1, 0.1, (50, 2))
    points = cv2.projectPoints(
        np.column_stack([corners, np.zeros(50)]), pose[:3], pose[3:], np.eye(3), np.zeros(4)
    )[0].reshape(-1, 2)
    directions = torch.from_numpy(np.column_stack([points, np.ones(50)]))
    zero = torch.zeros(50, dtype=torch.float64)
    rays = Rays(
        Vector(zero, zero, zero), Vector.of(directions).unit(), torch.zeros(50, dtype=torch.uint8)
    )
    landed, failure = Target()(rays, Placement.of(torch.from_numpy(pose).expand(50, 6)), {})
    assert not failure.any()
    assert np.abs(landed.numpy() - corners).max() < 1e-13
    placed = Target().place(landed, Placement.of(torch.from_numpy(pose).expand(50, 6)), {})
    assert (placed[:, :2] / placed[:, 2:] - torch.from_numpy(points)).abs().max() < 1e-13


def test_a_board_behind_the_camera_is_missed() -> None:
    zero, item = torch.zeros(1, dtype=torch.float64), torch.ones(1, dtype=torch.float64)
    rays = Rays(
        Vector(zero, zero, zero), Vector(zero, zero, item), torch.zeros(1, dtype=torch.uint8)
    )
    _, failure = Target()(
        rays, Placement.of(torch.tensor([[0.0, 0, 0, 0, 0, -1.0]], dtype=torch.float64)), {}
    )
    assert failure.tolist() != [0]

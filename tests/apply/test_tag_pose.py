"""Poses from rays that do not meet: against a camera that is written down as a formula and has no
glass.
"""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.apply.tag_pose import SQUARE, Lines, measure_misfit, poses, starts

Array = NDArray[np.float64]

FOCAL = 1000.0
SIDE = 0.05


def feet(pixels: Array) -> Array:
    """(N, 2) m: where rays pass z = 0, up to 5 mm from the origin, by no law of optics."""
    u, v = pixels.T / FOCAL
    return 0.005 * np.column_stack([np.sin(3 * v) + u, np.cos(2 * u) * v])


def lines_of(pixels: Array) -> Lines:
    step = 1e-3
    by_pixel = np.stack(
        [(feet(pixels + d) - feet(pixels - d)) / (2 * step) for d in step * np.eye(2)], -1
    )
    return Lines(
        pixels / FOCAL, feet(pixels), np.tile(np.eye(2) / FOCAL, (len(pixels), 1, 1)), by_pixel
    )


def seen(points: Array) -> Array:
    """(N, 2) px: the pixel whose ray passes a point, by repetition."""
    pixels = FOCAL * points[:, :2] / points[:, 2:]
    for _ in range(60):
        pixels = FOCAL * (points[:, :2] - feet(pixels)) / points[:, 2:]
    return pixels


def pose(seed: int, depth: float, tilts: tuple[float, float] = (5, 60)) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    around, tilt = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(*tilts))
    turn = Rotation.from_rotvec(
        tilt * np.array([np.cos(around), np.sin(around), 0])
    ) * Rotation.from_rotvec([0, 0, rng.uniform(-3, 3)])
    return turn.as_matrix(), np.array([*rng.uniform(-0.4, 0.4, 2) * depth, depth])


@pytest.mark.parametrize("depth", [0.15, 0.3, 1.5])
@pytest.mark.parametrize("seed", range(8))
def test_exact_rays_give_the_pose(seed: int, depth: float) -> None:
    turn, shift = pose(seed, depth)
    corners = seen(SIDE * SQUARE @ turn.T + shift)
    result = poses(lines_of(corners), SIDE, np.eye(8) / 0.05)
    assert np.abs(result[0][1] - shift).max() < 1e-9
    assert np.abs(result[0][0] - turn).max() < 1e-8
    assert result[0][2] < 1e-12
    central = poses(
        replace(
            lines_of(corners), parallax=np.zeros((4, 2)), parallax_by_pixel=np.zeros((4, 2, 2))
        ),
        SIDE,
        np.eye(8) / 0.05,
    )
    assert np.linalg.norm(central[0][1] - shift) > 1e-4, "one centre for all rays would do as well"


@pytest.mark.parametrize("seed", range(4))
def test_the_start_is_close_to_the_solution(seed: int) -> None:
    turn, shift = pose(seed, 0.2)
    result = starts(lines_of(seen(SIDE * SQUARE @ turn.T + shift)), SIDE)
    assert min(np.linalg.norm(at - shift) for _, at in result) < 1e-5


def test_derivatives_are_central_differences() -> None:
    turn, shift = pose(3, 0.3)
    lines = lines_of(
        seen(SIDE * SQUARE @ turn.T + shift) + np.array([[3.0, -2], [1, 4], [-2, 1], [0, 2]])
    )
    misfit, step = measure_misfit(lines, SIDE, turn, shift), 1e-6

    def moved(by: Array) -> Array:
        return measure_misfit(lines, SIDE, cv2.Rodrigues(by[:3])[0] @ turn, shift + by[3:]).px

    by_pose = np.stack(
        [(moved(step * axis) - moved(-step * axis)) / (2 * step) for axis in np.eye(6)], -1
    )
    assert np.abs(by_pose - misfit.by_pose).max() < 1e-7 * np.abs(misfit.by_pose).max()
    by_size = (
        measure_misfit(lines, SIDE * (1 + step), turn, shift).px
        - measure_misfit(lines, SIDE * (1 - step), turn, shift).px
    ) / (2 * step)
    assert np.abs(by_size - misfit.by_size).max() < 1e-7 * np.abs(misfit.by_size).max()
    coefficients = np.concatenate([lines.at_infinity, lines.parallax], -1)

    def along(axis: int, by: float) -> Array:
        changed = coefficients + by * np.eye(4)[axis]
        return measure_misfit(
            replace(lines, at_infinity=changed[:, :2], parallax=changed[:, 2:]), SIDE, turn, shift
        ).px.reshape(4, 2)

    by_line = np.stack(
        [(along(axis, step) - along(axis, -step)) / (2 * step) for axis in range(4)], -1
    )
    assert np.abs(by_line - misfit.by_line).max() < 1e-7 * np.abs(misfit.by_line).max()


def test_the_misfit_is_that_of_the_picture() -> None:
    """Seen less expected pixels, to first order."""
    turn, shift = pose(5, 0.25)
    expected = seen(SIDE * SQUARE @ turn.T + shift)
    error = np.array([[0.3, -0.2], [0.1, 0.4], [-0.2, 0.1], [0.0, 0.2]])
    assert (
        np.abs(
            measure_misfit(lines_of(expected + error), SIDE, turn, shift).px.reshape(4, 2) - error
        ).max()
        < 1e-3
    )


def test_a_small_square_from_the_front_has_two_poses() -> None:
    turn, shift = pose(2, 1.5, (8, 9))
    result = poses(lines_of(seen(SIDE * SQUARE @ turn.T + shift)), SIDE, np.eye(8) / 0.3)
    assert len(result) == 2
    assert result[0][2] < 1e-9 < result[1][2] < 9
    assert np.linalg.norm(result[1][1] - shift) < 0.02
    assert np.rad2deg(np.arccos(result[1][0][:, 2] @ turn[:, 2])) > 8


def test_rays_that_no_square_explains_have_a_misfit() -> None:
    crossed = np.array([[0.0, 0.0], [100.0, 100.0], [100.0, 0.0], [0.0, 100.0]])
    assert all(cost > 100 for *_, cost in poses(lines_of(crossed), SIDE, np.eye(8)))


def test_four_corners_in_one_place_have_no_pose_that_is_not_finite() -> None:
    for turn, shift, cost in poses(lines_of(np.zeros((4, 2))), SIDE, np.eye(8)):
        assert np.isfinite([*turn.ravel(), *shift, cost]).all()

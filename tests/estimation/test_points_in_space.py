"""Targets whose points are on no plane: residuals, their derivatives and poses."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from calib.corners.view import View
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.priors import Priors
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.optics.build import pinhole_path
from calib.optics.exposure import MIDDLE
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.projection import project
from calib.optics.view_blocks import CENTRE
from calib.session.parameter_names import CAMERA
from calib.session.point_target import PointTarget
from fixtures.point_sessions import cloud, spatial_scene
from fixtures.synthetic import HEIGHT
from fixtures.wide import INTRINSICS as WIDE

NAMES = (CAMERA.fx, "cover.inner_radius", "cover.thickness")
STEP = 3e-6
"""Truncation makes 1e-7 of a derivative there, rounding 3e-7."""
Situation = Callable[[], tuple[Path, Values, Observations, torch.Tensor]]


def covered() -> tuple[Path, Values, Observations, torch.Tensor]:
    """Return a cloud of points through a cone, from two sides."""
    made = spatial_scene(3, 2, cloud(np.random.default_rng(3), 60))
    poses = made.poses.clone()
    return made.path, made.values, made.observations, poses


def through_fisheye() -> tuple[Path, Values, Observations, torch.Tensor]:
    """Return a cloud of points around the axis and far from it, through a wide lens."""
    path, values = pinhole_path(WIDE)
    target = PointTarget.of(cloud(np.random.default_rng(4), 60))
    poses = torch.tensor(
        [[0.3, -0.2, 0.1, 0.05, 0.0, 0.5], [1.9, 0.4, -1.0, 0.6, 0.1, 0.15]], dtype=torch.float64
    )
    views: list[View] = []
    for pose in poses:
        points = path.place(torch.from_numpy(target.points()), values, pose, MIDDLE)
        pixels = project(path, values, points, MIDDLE).numpy()
        assert np.isfinite(pixels).all()
        views.append(View(str(len(views)), pixels, np.ones(target.count)))
    return path, values, Observations.of(views, target), poses


@pytest.mark.parametrize("blocks", ["pose", "shutter", "centre"])
@pytest.mark.parametrize("scene", [covered, through_fisheye])
def test_derivatives_agree_with_central_differences(scene: Situation, blocks: str) -> None:
    """The planes of a wide lens turn with the points, which changes a residual by a small part of
    itself: this derivative is left out.
    """
    path, values, observations, poses = scene()
    observations = observations.add_times(None, HEIGHT)
    names = [name for name in NAMES if name in values]
    parameters = Parameters.of(path, values, Priors(dict.fromkeys(names, 1.0)))
    generator = torch.Generator().manual_seed(0)
    if blocks == "shutter":
        path = replace(path, shutter=True)
    if blocks == "centre":
        path = replace(path, camera_block=CENTRE)
    count = {"pose": 0, "shutter": 6, "centre": 2}[blocks]
    size = 1e-3 if blocks == "shutter" else 1e-2
    added = size * torch.randn(2, count, dtype=torch.float64, generator=generator)
    poses = torch.cat([poses, added], 1)
    weights = pixel_weights(path, values, observations, poses, 1.0)
    (block,) = make_residual_blocks(path, parameters, observations, weights)

    def residual(shared: torch.Tensor, views: torch.Tensor) -> torch.Tensor:
        at = parameters.values(shared)
        result, lands = block.residual(block.rays(at, views), at, views)
        assert lands.all()
        return result

    shared = parameters.vector(values)
    linear = block.linearise(values, poses)
    if blocks == "pose":
        assert linear.residual.abs().max() < 1e-3
    worst = 0.0
    for column in range(len(shared)):
        step = STEP * torch.eye(len(shared), dtype=torch.float64)[column]
        slope = (residual(shared + step, poses) - residual(shared - step, poses)) / (2 * STEP)
        worst = max(worst, relative(slope, linear.jacobian_shared[..., column]))
    by_view = block.residual_with_jacobian(block.rays(values, poses), values, poses)[1]
    for column in range(poses.shape[1]):
        step = torch.zeros_like(poses)
        step[:, column] = STEP
        slope = (residual(shared, poses + step) - residual(shared, poses - step)) / (2 * STEP)
        worst = max(worst, relative(slope, linear.jacobian_block[..., column]))
        worst = max(worst, relative(slope, by_view[..., column]))
    print(scene.__name__, blocks, worst)
    assert worst < (1e-6 if scene is covered else 1e-3)


def relative(slope: torch.Tensor, derivative: torch.Tensor) -> float:
    """Return the largest difference over the largest derivative."""
    assert slope.abs().max() > 0
    return float((slope - derivative).abs().max() / slope.abs().max())

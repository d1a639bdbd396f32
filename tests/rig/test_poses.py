"""The composition of poses, against matrices and central differences."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from calib.rig.poses import (
    compose,
    compose_with_derivatives,
    invert_poses,
    pose_matrix,
    rotation_vector,
)

STEP = 1e-6


def draw(seed: int, count: int, angle: float) -> Tensor:
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(count, 3))
    axes *= angle / np.linalg.norm(axes, axis=1, keepdims=True)
    return torch.from_numpy(np.column_stack([axes, rng.uniform(-1, 1, (count, 3))]))


def test_composition_is_the_product_of_matrices() -> None:
    mountings = draw(1, 20, 0.5)
    placements = draw(2, 20, 2.5)
    poses = compose(mountings, placements)
    for mounting, placement, pose in zip(mountings, placements, poses, strict=True):
        product = pose_matrix(mounting) @ pose_matrix(placement)
        assert np.abs(pose_matrix(pose) - product).max() < 1e-13


def test_inverse_undoes_a_pose() -> None:
    poses = draw(3, 20, 2.0)
    assert float(compose(invert_poses(poses), poses).abs().max()) < 1e-13


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, 3.0, np.pi - 1e-9, np.pi])
def test_rotation_vectors_of_all_angles(angle: float) -> None:
    vectors = draw(4, 50, angle)[:, :3].numpy()
    turns = Rotation.from_rotvec(vectors).as_matrix()
    again = rotation_vector(torch.from_numpy(turns)).numpy()
    assert np.abs(Rotation.from_rotvec(again).as_matrix() - turns).max() < 1e-14
    assert np.linalg.norm(again, axis=1).max() <= np.pi + 1e-12
    if angle < 3.1:
        assert np.abs(again - vectors).max() < 1e-12


@pytest.mark.parametrize(("mounting_angle", "angle"), [(0.0, 0.3), (0.4, 1.2), (1.5, 2.2)])
def test_derivatives_agree_with_central_differences(mounting_angle: float, angle: float) -> None:
    mounting = draw(5, 1, mounting_angle)[0]
    placements = draw(6, 10, angle)
    composed = compose_with_derivatives(mounting, placements)
    for i, step in enumerate(STEP * torch.eye(6, dtype=torch.float64)):
        by_mounting = compose(mounting + step, placements) - compose(mounting - step, placements)
        by_placement = compose(mounting, placements + step) - compose(mounting, placements - step)
        for derivative, difference in (
            (composed.by_mounting[..., i], by_mounting),
            (composed.by_placement[..., i], by_placement),
        ):
            assert float((derivative - difference / (2 * STEP)).abs().max()) < 1e-8
            assert float(derivative.abs().max()) > 0.1

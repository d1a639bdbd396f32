"""The board: where a ray lands on it."""

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics import rotation
from calib.optics.rays import MISSED_TARGET, Rays


@dataclass(frozen=True, slots=True)
class Plane:
    """A flat board. A pose is a rotation vector (rad) and a translation (m): T_camera_board as six numbers."""

    def __call__(self, rays: Rays, poses: Tensor) -> tuple[Tensor, Tensor]:
        """Where rays meet the board.

        Args:
            rays: (...) bundle in the camera frame.
            poses: (..., 6) T_camera_board of each ray's board.

        Returns:
            (..., 2) m board coordinates, and (...) uint8 failures.
        """
        turn = rotation.matrix(poses[..., :3])  # (..., 3, 3)
        origin = ((rays.origin - poses[..., 3:]).unsqueeze(-2) @ turn).squeeze(-2)  # R^T (o - t)
        direction = (rays.direction.unsqueeze(-2) @ turn).squeeze(-2)
        along = direction[..., 2]
        grazing = along.abs() < 1e-6
        distance = -origin[..., 2] / torch.where(grazing, torch.ones_like(along), along)
        landed = origin[..., :2] + distance.unsqueeze(-1) * direction[..., :2]
        return landed, rays.fail(grazing | (distance <= 0), MISSED_TARGET)

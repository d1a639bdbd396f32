"""The board: where a ray lands on it."""

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics import rotation
from calib.optics.rays import MISSED_TARGET, Rays
from calib.optics.vector import Vector


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
        turn = rotation.matrix(poses[..., :3])
        origin = (rays.origin - Vector.of(poses[..., 3:])).turned(turn, back=True)
        direction = rays.direction.turned(turn, back=True)
        grazing = direction.z.abs() < 1e-6
        distance = -origin.z / torch.where(grazing, torch.ones_like(direction.z), direction.z)
        landed = origin + direction * distance
        failed = rays.moved(landed, direction, (grazing | (distance <= 0), MISSED_TARGET))
        return torch.stack([landed.x, landed.y], -1), failed.failure

    def place(self, corners: Tensor, poses: Tensor) -> Tensor:
        """(..., 2) m board coordinates on boards at (..., 6) to (..., 3) m in the camera frame."""
        flat = Vector(corners[..., 0], corners[..., 1], torch.zeros_like(corners[..., 0]))
        return flat.turned(rotation.matrix(poses[..., :3])).stacked() + poses[..., 3:]

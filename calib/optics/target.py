"""The board: where a ray lands on it."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics import rotation
from calib.optics.rays import MISSED_TARGET, Rays
from calib.optics.vector import Vector


@dataclass(frozen=True, slots=True)
class Placement:
    """Where boards stand: T_camera_board as a rotation and a translation."""

    turn: Tensor
    """(..., 3, 3)"""
    shift: Tensor
    """(..., 3) m"""

    @staticmethod
    def of(poses: Tensor) -> Placement:
        """From (..., 6): rotation vector (rad) and translation (m)."""
        return Placement(rotation.matrix(poses[..., :3]), poses[..., 3:])

    def __getitem__(self, rows: Tensor) -> Placement:
        return Placement(self.turn[rows], self.shift[rows])


@dataclass(frozen=True, slots=True)
class Plane:
    """A flat board."""

    def __call__(self, rays: Rays, placement: Placement) -> tuple[Tensor, Tensor]:
        """Where rays meet the board.

        Args:
            rays: (...) bundle in the camera frame.
            placement: (...) of each ray's board.

        Returns:
            (..., 2) m board coordinates, and (...) uint8 failures.
        """
        origin = (rays.origin - Vector.of(placement.shift)).turned(placement.turn, back=True)
        direction = rays.direction.turned(placement.turn, back=True)
        grazing = direction.z.abs() < 1e-6
        distance = -origin.z / torch.where(grazing, torch.ones_like(direction.z), direction.z)
        landed = origin + direction * distance
        failed = rays.moved(landed, direction, (grazing | (distance <= 0), MISSED_TARGET))
        return torch.stack([landed.x, landed.y], -1), failed.failure

    def place(self, corners: Tensor, poses: Tensor) -> Tensor:
        """(..., 2) m board coordinates on boards at (..., 6) to (..., 3) m in the camera frame."""
        flat = Vector(corners[..., 0], corners[..., 1], torch.zeros_like(corners[..., 0]))
        return flat.turned(rotation.matrix(poses[..., :3])).stacked() + poses[..., 3:]

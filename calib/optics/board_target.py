"""The board as the last stage of the ray path: where a ray lands, in nominal board coordinates, and where a corner is in space.

Bends move its surface along the normal; prints move its corners in its plane; a rolling shutter moves it line by line.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from calib.optics import rotation
from calib.optics.params import Param, Values
from calib.optics.rays import MISSED_TARGET, Rays
from calib.optics.vector import Vector

STEPS = 3
"""Newton steps onto a board that is not flat, before the differentiable one: bends of millimetres over a board need two."""


@dataclass(frozen=True, slots=True)
class Placement:
    """Where boards stand: T_camera_board as a rotation and a translation."""

    turn: Tensor
    """(..., 3, 3)"""
    shift: Tensor
    """(..., 3) m"""
    motion: Tensor | None = None
    """(..., 6): by how much a board turns (rotation vector in the camera frame, rad) and moves (m) during a picture's readout."""

    @staticmethod
    def of(parameters: Tensor) -> Placement:
        """From (..., 6), rotation vector (rad) and translation (m), or (..., 12), the motion behind them."""
        return Placement(
            rotation.matrix(parameters[..., :3]), parameters[..., 3:6], parameters[..., 6:] if parameters.shape[-1] > 6 else None
        )

    def __getitem__(self, rows: Tensor) -> Placement:
        return Placement(self.turn[rows], self.shift[rows], None if self.motion is None else self.motion[rows])

    def during(self, line: Tensor | None) -> Placement:
        """Where the boards are while a line (...) of the picture is read, from -0.5, the first, to 0.5."""
        if self.motion is None or line is None:
            return self
        moved = self.motion * line.unsqueeze(-1)
        return Placement(rotation.matrix(moved[..., :3]) @ self.turn, self.shift + moved[..., 3:])


class Bend(Protocol):
    """What makes a printed board not flat."""

    @property
    def params(self) -> tuple[Param, ...]: ...

    def height(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor, Tensor]:
        """(...) m board coordinates to (...) m away from the camera, and its slopes by x and by y."""
        ...


class Print(Protocol):
    """What puts printed corners elsewhere than the board's description says."""

    @property
    def params(self) -> tuple[Param, ...]: ...

    def shift(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor]:
        """(...) m nominal board coordinates to the (...) m by which they are moved."""
        ...


@dataclass(frozen=True, slots=True)
class Target:
    """A board, flat and printed as described unless something is added."""

    bends: tuple[Bend, ...] = ()
    prints: tuple[Print, ...] = ()

    @property
    def params(self) -> tuple[Param, ...]:
        return (*(param for bend in self.bends for param in bend.params), *(param for part in self.prints for param in part.params))

    def __call__(self, rays: Rays, placement: Placement, values: Values) -> tuple[Tensor, Tensor]:
        """Where rays meet the board.

        Args:
            rays: (...) bundle in the camera frame.
            placement: (...) of each ray's board.
            values: the parameters of bends and prints.

        Returns:
            (..., 2) m nominal board coordinates, and (...) uint8 failures.
        """
        origin = (rays.origin - Vector.of(placement.shift)).turned(placement.turn, back=True)
        direction = rays.direction.turned(placement.turn, back=True)
        grazing = direction.z.abs() < 1e-6
        distance = -origin.z / torch.where(grazing, torch.ones_like(direction.z), direction.z)
        for _ in range(STEPS if self.bends else 0):
            distance = self._closer(origin.detach(), direction.detach(), distance.detach(), values)
        if self.bends:
            distance = self._closer(origin, direction, distance, values)
        landed = origin + direction * distance
        failed = rays.moved(landed, direction, (grazing | (distance <= 0), MISSED_TARGET))
        return torch.stack(self._nominal(landed.x, landed.y, values), -1), failed.failure

    def place(self, corners: Tensor, placement: Placement, values: Values) -> Tensor:
        """(..., 2) m nominal board coordinates on (...) boards to (..., 3) m in the camera frame."""
        x, y = corners.unbind(-1)
        for part in self.prints:
            across, down = part.shift(corners[..., 0], corners[..., 1], values)
            x, y = x + across, y + down
        z = sum((bend.height(x, y, values)[0] for bend in self.bends), torch.zeros_like(x))
        return Vector(x, y, z).turned(placement.turn).stacked() + placement.shift

    def _closer(self, origin: Vector, direction: Vector, distance: Tensor, values: Values) -> Tensor:
        """Newton's step along the rays, onto the bent board."""
        point = origin + direction * distance
        above, slope = point.z, direction.z
        for bend in self.bends:
            height, by_x, by_y = bend.height(point.x, point.y, values)
            above, slope = above - height, slope - by_x * direction.x - by_y * direction.y
        slope = slope.detach()
        return distance - above / torch.where(slope.abs() < 1e-6, torch.ones_like(slope), slope)

    def _nominal(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor]:
        """Printed to nominal board coordinates: two rounds of putting the shift back, each a hundredth of the one before."""
        back_x, back_y = x, y
        for _ in range(2 if self.prints else 0):
            shifts = [part.shift(back_x, back_y, values) for part in self.prints]
            back_x, back_y = x - sum(s[0] for s in shifts), y - sum(s[1] for s in shifts)
        return back_x, back_y

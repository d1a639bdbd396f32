"""Three-vectors by component: the fastest layout for a bundle, where sums over a last axis of three
are slow.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, slots=True)
class Vector:
    """A bundle of vectors; x, y and z are (...) each, or broadcast against each other."""

    x: Tensor
    y: Tensor
    z: Tensor

    @staticmethod
    def of(stacked: Tensor) -> Vector:
        """From (..., 3)."""
        return Vector(*stacked.unbind(-1))

    def stacked(self) -> Tensor:
        """To (..., 3)."""
        return torch.stack(torch.broadcast_tensors(self.x, self.y, self.z), -1)  # type: ignore[no-untyped-call]

    def __add__(self, other: Vector) -> Vector:
        return Vector(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: Vector) -> Vector:
        return Vector(self.x - other.x, self.y - other.y, self.z - other.z)

    def __mul__(self, factor: Tensor) -> Vector:
        return Vector(self.x * factor, self.y * factor, self.z * factor)

    def dot(self, other: Vector) -> Tensor:
        """(...)"""
        return self.x * other.x + self.y * other.y + self.z * other.z

    def cross(self, other: Vector) -> Vector:
        return Vector(
            self.y * other.z - self.z * other.y,
            self.z * other.x - self.x * other.z,
            self.x * other.y - self.y * other.x,
        )

    def unit(self) -> Vector:
        """Scaled to length one. Not for zero vectors."""
        return self * self.dot(self).rsqrt()

    def detach(self) -> Vector:
        return Vector(self.x.detach(), self.y.detach(), self.z.detach())

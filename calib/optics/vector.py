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
        """Return the vectors of a (..., 3) tensor."""
        return Vector(*stacked.unbind(-1))

    def stacked(self) -> Tensor:
        """Return the vectors as a (..., 3) tensor."""
        broadcast = torch.broadcast_tensors
        components = broadcast(self.x, self.y, self.z)  # type: ignore[no-untyped-call]
        return torch.stack(components, -1)

    def __add__(self, vector: Vector) -> Vector:
        return Vector(self.x + vector.x, self.y + vector.y, self.z + vector.z)

    def __sub__(self, vector: Vector) -> Vector:
        return Vector(self.x - vector.x, self.y - vector.y, self.z - vector.z)

    def __mul__(self, factor: Tensor) -> Vector:
        return Vector(self.x * factor, self.y * factor, self.z * factor)

    def dot(self, vector: Vector) -> Tensor:
        """Return the (...) scalar product."""
        return self.x * vector.x + self.y * vector.y + self.z * vector.z

    def cross(self, vector: Vector) -> Vector:
        return Vector(
            self.y * vector.z - self.z * vector.y,
            self.z * vector.x - self.x * vector.z,
            self.x * vector.y - self.y * vector.x,
        )

    def unit(self) -> Vector:
        """Return the vectors scaled to length one. No vector may be zero."""
        return self * self.dot(self).rsqrt()

    def detach(self) -> Vector:
        return Vector(self.x.detach(), self.y.detach(), self.z.detach())

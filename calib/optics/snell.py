"""Snell's law at one interface."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.vector import Vector


@dataclass(frozen=True, slots=True)
class Refraction:
    """Unit rays that an interface bends by Snell's law.

    A ray that is totally reflected keeps its direction: finite, with finite derivatives.
    """

    direction: Vector
    """(...) unit, towards the surface."""
    normal: Vector
    """(...) unit, on the side that the rays go to."""
    ratio: Tensor
    """() or (...) n_from / n_to."""
    cos_in: Tensor
    """(...)"""
    cos_out: Tensor
    """(...); 1 for a ray that is totally reflected."""
    reflected: Tensor
    """(...) bool, true where the light is totally reflected."""

    @staticmethod
    def of(direction: Vector, normal: Vector, ratio: Tensor) -> Refraction:
        """Refract rays; the arguments are the fields of the same names."""
        cos_in = direction.dot(normal)
        cos2_out = 1 - ratio**2 * (1 - cos_in**2)
        reflected = cos2_out <= 0
        cos_out = torch.where(
            reflected, torch.ones_like(cos2_out), cos2_out
        ).sqrt()  # masked before the root
        return Refraction(direction, normal, ratio, cos_in, cos_out, reflected)

    @property
    def bent(self) -> Vector:
        """(...) unit bent directions."""
        return self.direction * self._gain + self.normal * self._push

    def pull(self, by_bent: Vector) -> tuple[Vector, Vector, Tensor]:
        """Return the (k, ...) derivatives by direction, normal and ratio, from those by the bent
        directions.
        """
        by_push = self.normal.dot(by_bent)
        inclination = self.ratio**2 * self.cos_in / self.cos_out - self.ratio
        by_cos = by_push * torch.where(self.reflected, 0.0, inclination)
        growth = self.ratio * (self.cos_in**2 - 1) / self.cos_out - self.cos_in
        by_ratio = torch.where(self.reflected, 0.0, self.direction.dot(by_bent) + by_push * growth)
        return (
            by_bent * self._gain + self.normal * by_cos,
            by_bent * self._push + self.direction * by_cos,
            by_ratio,
        )

    @property
    def _gain(self) -> Tensor:
        return torch.where(self.reflected, torch.ones_like(self.cos_out), self.ratio)

    @property
    def _push(self) -> Tensor:
        push = self.cos_out - self.ratio * self.cos_in
        return torch.where(self.reflected, torch.zeros_like(push), push)

"""A pane of glass before a flat target: a screen has one before its pixels."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.derivatives import ByName
from calib.optics.params import Param, Values
from calib.optics.vector import Vector

FLATTEST = 1e-6
"""The sine of the smallest angle at which a ray meets a target."""


@dataclass(frozen=True, slots=True)
class FrontGlass:
    """A flat pane on the camera's side of the target, with air on its other side.

    By Snell's law, the sine of a ray's angle over the index is its sine in the glass. Directions
    are (...) unit vectors in the target's frame, whose z is the normal.
    """

    thickness: Param
    """m"""
    index: float
    """Refractive index of the glass."""

    def shift(self, direction: Vector, values: Values) -> tuple[Tensor, Tensor]:
        """Return by how many (...) m, along x and y, the glass moves the point that a ray sees."""
        shift = values[self.thickness.name] * self._factor(direction)
        return shift * direction.x, shift * direction.y

    def pull(
        self, direction: Vector, values: Values, by_point: tuple[Tensor, Tensor]
    ) -> tuple[Vector, ByName]:
        """Return the derivatives by the direction and by the thickness, from the (k, ...) ones by
        the point that is seen.
        """
        thickness = values[self.thickness.name]
        factor, growth = self._factor(direction), self._root(direction) ** 3
        by_x, by_y = by_point
        product = direction.x * by_x + direction.y * by_y
        by_direction = Vector(
            thickness * (factor * by_x + growth * direction.x * product),
            thickness * (factor * by_y + growth * direction.y * product),
            thickness * product * direction.z.sign() / _cosine(direction) ** 2,
        )
        return by_direction, {self.thickness.name: factor * product}

    def _factor(self, direction: Vector) -> Tensor:
        """Return the shift for each m of thickness, over the direction's x or y."""
        return self._root(direction) - 1 / _cosine(direction)

    def _root(self, direction: Vector) -> Tensor:
        """Return one over the index times the cosine in the glass."""
        return (self.index**2 - direction.x**2 - direction.y**2).rsqrt()


def _cosine(direction: Vector) -> Tensor:
    """Return the cosine between rays and the normal, one where they graze the target."""
    cosine = direction.z.abs()
    return torch.where(cosine < FLATTEST, torch.ones_like(cosine), cosine)

"""Rays that cross one surface of the cover, and the derivatives of the crossing in closed form.

The hit point x = o + t d has the height F(x) = 0 over the surface with its relief. So dt = -(dF +
grad F . (do + t dd)) / (grad F . d), by the implicit function theorem. The bent direction follows
from Snell's law with the normal, whose change along the surface is the surface's curvature.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.relief import Expansion
from calib.optics.snell import Refraction
from calib.optics.surface import Surface
from calib.optics.vector import Vector

NEWTON_STEPS = (2, 1)
"""The numbers of Newton steps towards an uneven surface, onto one expansion of its relief after the
other. The first is taken where the smooth surface is hit. For bumps 3 mm wide and 10 um high, on
glass 1e-4 m away, two steps onto it end 1e-12 m from the surface; there the second is taken.
"""
FLATTEST = 1e-3
"""The smallest change of the height per metre along a ray that is used as a divisor."""


@dataclass(frozen=True, slots=True)
class HitDerivatives:
    """The (k, M) derivatives of k outputs by what a crossing reads, in the cover's frame."""

    origin: Vector
    direction: Vector
    height: Tensor
    """By the height of the point over the surface: minus that by the glass's thickness."""
    gradient: Vector
    """By the gradient of that height, beyond its change with the point."""
    slopes: tuple[Tensor, Tensor]
    """By the relief's two slopes."""
    chart: tuple[Tensor, Tensor]
    """By the two chart coordinates at which the relief is read."""
    ratio: Tensor


@dataclass(frozen=True, slots=True)
class Crossing:
    """M rays at a surface, in the frame of its cover."""

    surface: Surface
    origin: Vector
    direction: Vector
    distance: Tensor
    """(M,) m from the origin to the hit."""
    point: Vector
    relief: Expansion | None
    """The sum of the reliefs, around a point next to the hit."""
    exact_hit: bool
    """True if the relief moves the hit."""
    gradient: Vector
    """The gradient of the height above the surface with its relief, at the hit."""
    hit_gradient: Vector
    """That of the surface which is hit: the same, unless the relief only tilts the normal."""
    refraction: Refraction

    def pull(self, by_point: Vector, by_bent: Vector) -> HitDerivatives:
        """Return the derivatives by what the crossing reads, from the (k, M) derivatives by the hit
        and by the bent direction.
        """
        by_direction, by_normal, by_ratio = self.refraction.pull(by_bent)
        normal = self.refraction.normal
        by_gradient = (by_normal - normal * normal.dot(by_normal)) * (
            self.gradient.dot(self.gradient).rsqrt()
        )
        by_point = by_point + self.surface.curvature(self.point, by_gradient)
        zero = torch.zeros_like(by_ratio)
        by_slopes = by_chart = zero, zero
        if self.relief:
            _, first, second = self.relief.at(self.chart)
            by_point = by_point - self.surface.chart_curvature(
                self.point, first, second, by_gradient
            )
            along_first, along_second = self.surface.chart_change(self.point, by_gradient)
            by_slopes = -along_first, -along_second
            by_chart = self.relief.bend(*by_slopes)
            by_point = by_point + self.surface.chart_gradient(self.point, *by_chart)
        by_height = -self.direction.dot(by_point) / divisor(self.hit_gradient.dot(self.direction))
        if self.relief and self.exact_hit:
            by_chart = by_chart[0] - by_height * first, by_chart[1] - by_height * second
        by_origin = by_point + self.hit_gradient * by_height
        return HitDerivatives(
            by_origin,
            by_direction + by_origin * self.distance,
            by_height,
            by_gradient,
            by_slopes,
            by_chart,
            by_ratio,
        )

    @property
    def chart(self) -> tuple[Tensor, Tensor]:
        """The two (M,) chart coordinates of the hit."""
        return self.surface.chart(self.point)


def divisor(slope: Tensor) -> Tensor:
    """Return a (...) change of the height per metre along a ray as a divisor, never close to
    zero.
    """
    return torch.where(slope.abs() < FLATTEST, torch.ones_like(slope), slope)

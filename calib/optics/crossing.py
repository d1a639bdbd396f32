"""Rays that cross one surface of the cover, and the derivatives of the crossing in closed form.

The hit point x = o + t d has the height F(x) = 0 over the surface with its relief. So dt = -(dF +
grad F . (do + t dd)) / (grad F . d), by the implicit function theorem. The bent direction follows
from Snell's law with the normal, whose change along the surface is the surface's curvature.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.derivatives import ByRay
from calib.optics.params import Values
from calib.optics.rays import Rays
from calib.optics.relief import Expansion
from calib.optics.relief_view import ReliefPlace
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

    rays: ByRay
    """Derivatives by the rays that enter."""
    height: Tensor
    """Derivatives by the height of the point over the surface: minus those by the thickness."""
    gradient: Vector
    """Derivatives by the gradient of that height, beyond its change with the point."""
    slopes: tuple[Tensor, Tensor]
    """Derivatives by the relief's two slopes."""
    ratio: Tensor
    """Derivatives by the index before the surface over that behind it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """M rays at a surface, in the frame of its cover."""

    surface: Surface
    entered: Rays
    distance: Tensor
    """(M,) m from the rays' origins to the hits."""
    point: Vector
    """The hits."""
    relief: Expansion | None
    """The sum of the reliefs, around points next to the hits."""
    chart: tuple[Tensor, Tensor] | None
    """The two (M,) chart coordinates of the hits, if there is a relief."""
    outer: tuple[ReliefPlace, Expansion] | None
    """The place of the outer relief, and its part of `relief`."""
    slopes: tuple[Tensor, Tensor] | None
    """The relief's two (M,) slopes at the hits."""
    exact_hit: bool
    """True if the relief moves the hits."""
    inverse_gradient: Tensor
    """(M,) 1 over the length of the gradient of the height above the uneven surface."""
    hit_gradient: Vector
    """The gradient of the height above the surface that is hit."""
    refraction: Refraction

    @property
    def relief_chart(self) -> tuple[Tensor, Tensor]:
        """The two (M,) coordinates of its own at which the outer relief is read."""
        assert self.chart
        return self.outer[0].to_relief(self.chart) if self.outer else self.chart

    def pull(self, by_rays: ByRay, values: Values) -> HitDerivatives:
        """Return the derivatives by what the crossing reads, from those by the rays that leave."""
        by_direction, by_normal, by_ratio = self.refraction.pull(by_rays.direction)
        normal = self.refraction.normal
        by_gradient = (by_normal - normal * normal.dot(by_normal)) * self.inverse_gradient
        by_point = by_rays.origin + self.surface.curvature(self.point, by_gradient, values)
        by_slopes = torch.zeros_like(by_ratio), torch.zeros_like(by_ratio)
        if self.relief and self.slopes:
            by_point = by_point - self.surface.chart_curvature(
                self.point, *self.slopes, by_gradient
            )
            along_first, along_second = self.surface.chart_change(self.point, by_gradient)
            by_slopes = -along_first, -along_second
            by_chart = self.relief.bend(*by_slopes)
            by_point = by_point + self.surface.chart_gradient(self.point, *by_chart)
        direction = self.entered.direction
        by_height = -direction.dot(by_point) / divisor(self.hit_gradient.dot(direction))
        by_origin = by_point + self.hit_gradient * by_height
        return HitDerivatives(
            ByRay(by_origin, by_direction + by_origin * self.distance),
            by_height,
            by_gradient,
            by_slopes,
            by_ratio,
        )


def divisor(slope: Tensor) -> Tensor:
    """Return a (...) change of the height per metre along a ray as a divisor, never close to
    zero.
    """
    return torch.where(slope.abs() < FLATTEST, torch.ones_like(slope), slope)

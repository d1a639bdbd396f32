"""A cone around the y axis of the cover's frame; with no slope, a cylinder (the paper's
Fig. 1b).
"""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from calib.optics.derivatives import ByName
from calib.optics.params import Param, Values
from calib.optics.vector import Vector
from calib.session.parameter_names import COVER, CoverNames


@dataclass(frozen=True, slots=True)
class Cone:
    """Surfaces rho = inner_radius + radius_slope y + height: equal apertures, the thickness
    constant along the radius.

    Its chart is (y, theta): metres along the axis and the polar angle from +z towards +x, in rad,
    so theta = 0 is on the YOZ plane with positive z.
    """

    names: CoverNames = COVER
    symmetry: ClassVar[str] = "y"

    @property
    def radius(self) -> str:
        return self.names.of("inner_radius")

    @property
    def slope(self) -> str:
        return self.names.of("radius_slope")

    @property
    def params(self) -> tuple[Param, ...]:
        return Param(self.radius, "m", 1e-3), Param(self.slope, "", 1e-2)

    def reach(
        self, origin: Vector, direction: Vector, height: Tensor, values: Values
    ) -> tuple[Tensor, Tensor]:
        slope = values[self.slope]
        radius = (
            values[self.radius] + height + slope * origin.y
        )  # (...) of the surface at the origin's y
        # a t^2 + 2 b t + c = 0, and c < 0 inside: the way out is -c / (b + sqrt(b^2 - a c)), which
        # stays exact for a -> 0.
        steep = slope * direction.y
        a = direction.x**2 + direction.z**2 - steep**2
        b = origin.x * direction.x + origin.z * direction.z - steep * radius
        c = origin.x**2 + origin.z**2 - radius**2
        disc = b**2 - a * c
        no_root = disc <= 0
        below = b + torch.where(no_root, torch.ones_like(disc), disc).sqrt()
        no_root = no_root | (below <= 1e-9)
        distance = torch.where(
            no_root, torch.zeros_like(c), -c / torch.where(no_root, torch.ones_like(below), below)
        )
        beyond_apex = radius + steep * distance <= 0
        return distance, no_root | beyond_apex | (distance < 0)

    def height(self, points: Vector, values: Values) -> Tensor:
        return _rho(points) - values[self.radius] - values[self.slope] * points.y

    def gradient(self, points: Vector, values: Values) -> Vector:
        inverse = 1 / _rho(points)
        return Vector(points.x * inverse, -values[self.slope], points.z * inverse)

    def chart(self, points: Vector) -> tuple[Tensor, Tensor]:
        return points.y, torch.atan2(points.x, points.z)

    def chart_gradient(self, points: Vector, first: Tensor, second: Tensor) -> Vector:
        around = second / (points.x**2 + points.z**2 + 1e-30)
        return Vector(around * points.z, first, -around * points.x)

    def curvature(self, points: Vector, step: Vector, values: Values) -> Vector:
        del values
        inverse = 1 / _rho(points)
        x, z = points.x * inverse, points.z * inverse
        turn = (z * step.x - x * step.z) * inverse
        return Vector(z * turn, torch.zeros_like(turn), -x * turn)

    def by_parameters(
        self, points: Vector, by_height: Tensor, by_gradient: Vector, values: Values
    ) -> ByName:
        del values
        return {self.radius: -by_height, self.slope: -points.y * by_height - by_gradient.y}

    def chart_change(self, points: Vector, step: Vector) -> tuple[Tensor, Tensor]:
        around = (points.z * step.x - points.x * step.z) / (points.x**2 + points.z**2 + 1e-30)
        return step.y, around

    def chart_curvature(
        self, points: Vector, first: Tensor, second: Tensor, step: Vector
    ) -> Vector:
        del first
        inverse = 1 / (points.x**2 + points.z**2 + 1e-30)
        around = second * inverse
        fall = 2 * inverse * (points.x * step.x + points.z * step.z)
        return Vector(
            around * (step.z - fall * points.z),
            torch.zeros_like(fall),
            around * (fall * points.x - step.x),
        )


def _rho(points: Vector) -> Tensor:
    """Return the (...) m distance from the axis, never exactly zero, so that it is
    differentiable.
    """
    return (points.x**2 + points.z**2 + 1e-30).sqrt()

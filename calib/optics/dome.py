"""A dome: concentric spheres around the origin of the cover's frame."""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from calib.optics.derivatives import ByName
from calib.optics.params import Param, Values
from calib.optics.vector import Vector
from calib.session.parameter_names import COVER, CoverNames


@dataclass(frozen=True, slots=True)
class Dome:
    """Surfaces r = inner_radius + height: the thickness is constant along the radius.

    Its chart is (elevation, azimuth) in rad: elevation from the XOZ plane towards +y, azimuth
    around the y axis from +z towards +x. Both are 0 straight ahead; the grid's poles are straight
    up and down, where no forward-looking camera sees.
    """

    names: CoverNames = COVER
    symmetry: ClassVar[str] = "xyz"

    @property
    def radius(self) -> str:
        return self.names.of("inner_radius")

    @property
    def params(self) -> tuple[Param, ...]:
        return (Param(self.radius, "m", 1e-3),)

    def reach(
        self, origin: Vector, direction: Vector, height: Tensor, values: Values
    ) -> tuple[Tensor, Tensor]:
        axial = origin.dot(direction)
        power = (values[self.radius] + height) ** 2 - origin.dot(origin)  # (...) m^2
        no_hit = power <= 0
        root = torch.where(no_hit, torch.ones_like(power), axial**2 + power).sqrt()
        return torch.where(no_hit, torch.zeros_like(root), root - axial), no_hit

    def height(self, points: Vector, values: Values) -> Tensor:
        return _length(points) - values[self.radius]

    def gradient(self, points: Vector, values: Values) -> Vector:  # noqa: ARG002
        return points * (1 / _length(points))

    def chart(self, points: Vector) -> tuple[Tensor, Tensor]:
        return torch.atan2(points.y, _rho2(points).sqrt()), torch.atan2(points.x, points.z)

    def chart_gradient(self, points: Vector, first: Tensor, second: Tensor) -> Vector:
        rho2 = _rho2(points)
        up = first / ((rho2 + points.y**2) * rho2.sqrt())
        around = second / rho2
        fall = -up * points.y
        return Vector(
            fall * points.x + around * points.z, up * rho2, fall * points.z - around * points.x
        )

    def curvature(self, points: Vector, step: Vector, values: Values) -> Vector:
        del values
        inverse = 1 / _length(points)
        outward = points * inverse
        return (step - outward * outward.dot(step)) * inverse

    def by_parameters(
        self, points: Vector, by_height: Tensor, by_gradient: Vector, values: Values
    ) -> ByName:
        del points, by_gradient, values
        return {self.radius: -by_height}

    def chart_change(self, points: Vector, step: Vector) -> tuple[Tensor, Tensor]:
        unit = torch.ones_like(points.x)
        zero = torch.zeros_like(points.x)
        return (
            self.chart_gradient(points, unit, zero).dot(step),
            self.chart_gradient(points, zero, unit).dot(step),
        )

    def chart_curvature(
        self, points: Vector, first: Tensor, second: Tensor, step: Vector
    ) -> Vector:
        rho2 = _rho2(points)
        up = first / ((rho2 + points.y**2) * rho2.sqrt())
        around = second / rho2
        fall = -up * points.y
        rho2_change = 2 * (points.x * step.x + points.z * step.z)
        length2_change = rho2_change + 2 * points.y * step.y
        up_change = -up * (length2_change / (rho2 + points.y**2) + rho2_change / (2 * rho2))
        around_change = -around * rho2_change / rho2
        fall_change = -up_change * points.y - up * step.y
        return Vector(
            fall_change * points.x + fall * step.x + around_change * points.z + around * step.z,
            up_change * rho2 + up * rho2_change,
            fall_change * points.z + fall * step.z - around_change * points.x - around * step.x,
        )


def _length(points: Vector) -> Tensor:
    """Return the (...) m distance from the centre, never exactly zero, so that it is
    differentiable.
    """
    return (points.dot(points) + 1e-30).sqrt()


def _rho2(points: Vector) -> Tensor:
    """Return the (...) m^2 squared distance from the y axis, never exactly zero."""
    return points.x**2 + points.z**2 + 1e-30

"""A dome: concentric spheres around the origin of the cover's frame."""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

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


def _length(points: Vector) -> Tensor:
    """Return the (...) m distance from the centre, never exactly zero, so that it is
    differentiable.
    """
    return (points.dot(points) + 1e-30).sqrt()


def _rho2(points: Vector) -> Tensor:
    """Return the (...) m^2 squared distance from the y axis, never exactly zero."""
    return points.x**2 + points.z**2 + 1e-30

"""A window: parallel planes perpendicular to the z axis of the cover's frame."""

# ruff: noqa: ARG002 - a plane has no use for some of what the protocol passes.

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from calib.optics.derivatives import ByName
from calib.optics.params import Param, Values
from calib.optics.vector import Vector
from calib.session.parameter_names import COVER, CoverNames


@dataclass(frozen=True, slots=True)
class Flat:
    """Surfaces z = height: the thickness is constant along the normal. Only its frame has
    parameters.

    Its chart is (y, x) in m: the first coordinate runs down and the second to the right, as on an
    upright cone.
    """

    names: CoverNames = COVER
    params: ClassVar[tuple[Param, ...]] = ()
    symmetry: ClassVar[str] = "z"

    def reach(
        self, origin: Vector, direction: Vector, height: Tensor, values: Values
    ) -> tuple[Tensor, Tensor]:
        grazing = direction.z <= 1e-6
        distance = (height - origin.z) / torch.where(
            grazing, torch.ones_like(direction.z), direction.z
        )
        failed = grazing | (distance < 0)
        return torch.where(failed, torch.zeros_like(distance), distance), failed

    def height(self, points: Vector, values: Values) -> Tensor:
        return points.z

    def gradient(self, points: Vector, values: Values) -> Vector:
        zero = torch.zeros_like(points.z)
        return Vector(zero, zero, torch.ones_like(points.z))

    def chart(self, points: Vector) -> tuple[Tensor, Tensor]:
        return points.y, points.x

    def chart_gradient(self, points: Vector, first: Tensor, second: Tensor) -> Vector:
        return Vector(second, first, torch.zeros_like(points.z))

    def curvature(self, points: Vector, step: Vector, values: Values) -> Vector:
        zero = torch.zeros_like(step.z)
        return Vector(zero, zero, zero)

    def by_parameters(
        self, points: Vector, by_height: Tensor, by_gradient: Vector, values: Values
    ) -> ByName:
        return {}

    def chart_change(self, points: Vector, step: Vector) -> tuple[Tensor, Tensor]:
        return step.y, step.x

    def chart_curvature(
        self, points: Vector, first: Tensor, second: Tensor, step: Vector
    ) -> Vector:
        zero = torch.zeros_like(step.z)
        return Vector(zero, zero, zero)

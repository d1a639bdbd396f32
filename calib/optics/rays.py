"""A bundle of rays: origins, unit directions, and for each ray its first failure, if any."""

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.derivatives import ByRay
from calib.optics.rotation import Rotation
from calib.optics.vector import Vector
from calib.session.cover_section import MAX_COVERS, MAX_LAYERS

FAILURES = (
    "arrived",
    "the lens model cannot be inverted there",
    "missed the cover's inner surface",
    "totally reflected at the cover's inner surface",
    "missed the cover's outer surface",
    "totally reflected at the cover's outer surface",
    "missed the board's plane",
    *(
        sentence
        for surface in range(2, MAX_COVERS * (MAX_LAYERS + 1))
        for sentence in (
            f"missed the cover's surface {surface}",
            f"totally reflected at the cover's surface {surface}",
        )
    ),
)
"""A ray's `failure` is an index into this tuple: the first failure on its way, 0 if it arrived.
Surfaces count from the camera outwards. The first is the inner one, the last the outer one.
"""

FLATTEST = 1e-3
"""The smallest z of a unit direction that the picture of a pinhole holds. An undistorted picture is
one. This direction is 0.06 degrees short of sideways.
"""

LENS, MISSED_INNER, REFLECTED_INNER, MISSED_OUTER, REFLECTED_OUTER, MISSED_TARGET = range(1, 7)


def surface_failures(surface: int, surfaces: int) -> tuple[int, int]:
    """Return the failures of rays that miss a surface of the cover, and of rays that it reflects.
    `surface` is its number from the camera outwards, 1 to `surfaces`.
    """
    if surface == surfaces:
        return MISSED_OUTER, REFLECTED_OUTER
    if surface == 1:
        return MISSED_INNER, REFLECTED_INNER
    missed = MISSED_TARGET + 1 + 2 * (surface - 2)
    return missed, missed + 1


@dataclass(frozen=True, slots=True)
class Rays:
    """Rays in the camera frame.

    A failed ray stays finite, and so do its gradients, but they have no meaning.
    """

    origin: Vector
    """(...) m"""
    direction: Vector
    """(...) unit"""
    failure: Tensor
    """(...) uint8, index into FAILURES"""

    def advance(
        self,
        origin: Vector,
        direction: Vector,
        *failures: tuple[Tensor, int],
    ) -> "Rays":
        """Return the rays after a stage. Each (mask, code) sets the failure of the masked rays that
        have none yet.
        """
        failure = self.failure
        for mask, code in failures:
            failure = torch.where((failure == 0) & mask, torch.full_like(failure, code), failure)
        return Rays(origin, direction, failure)

    @property
    def in_pinhole(self) -> Tensor:
        """(...) bool, true where the ray exists and goes forward, so that the picture of a pinhole
        can show it.
        """
        return (self.failure == 0) & (self.direction.z > FLATTEST)

    def rotate(self, turn: Rotation) -> "Rays":
        """Return the rays in another frame with the same origin; `turn` leads to that frame."""
        return Rays(turn.turn(self.origin), turn.turn(self.direction), self.failure)

    def at_depth(self, depth: Tensor) -> Tensor:
        """Return the (..., 2) m x and y where each ray crosses the plane z = depth (...) m."""
        point = self.origin + self.direction * ((depth - self.origin.z) / self._forward)
        return torch.stack([point.x, point.y], -1)

    def at_depth_derivatives(self, depth: Tensor) -> ByRay:
        """Return the (2, ...) derivatives of `at_depth` by the rays."""
        forward = self._forward
        distance = (depth - self.origin.z) / forward
        unit, zero = torch.ones_like(distance), torch.zeros_like(distance)
        slopes = torch.stack([self.direction.x / forward, self.direction.y / forward])
        by_origin = Vector(torch.stack([unit, zero]), torch.stack([zero, unit]), -slopes)
        return ByRay(by_origin, by_origin * distance)

    @property
    def _forward(self) -> Tensor:
        z = self.direction.z
        return torch.where(z.abs() < 1e-9, torch.ones_like(z), z)

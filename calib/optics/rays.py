"""A bundle of rays: origins, unit directions, and for each ray the first failure on its way, if
there was one.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.rotation import Rotation
from calib.optics.vector import Vector

FAILURES = (
    "arrived",
    "the lens model cannot be inverted there",
    "missed the cover's inner surface",
    "totally reflected at the cover's inner surface",
    "missed the cover's outer surface",
    "totally reflected at the cover's outer surface",
    "missed the board's plane",
)
"""A ray's `failure` is an index into this tuple: the first thing that went wrong on its way, 0
where nothing did.
"""

FLATTEST = 1e-3
"""The smallest z of a unit direction that the picture of a pinhole holds. An undistorted picture is
one. This direction is 0.06 degrees short of sideways.
"""

LENS, MISSED_INNER, REFLECTED_INNER, MISSED_OUTER, REFLECTED_OUTER, MISSED_TARGET = range(1, 7)


@dataclass(frozen=True, slots=True)
class Rays:
    """Rays in the camera frame.

    A failed ray stays finite, and so do its gradients; `failure` says that it means nothing.
    """

    origin: Vector
    """(...) m"""
    direction: Vector
    """(...) unit"""
    failure: Tensor
    """(...) uint8, index into FAILURES"""

    def moved(
        self,
        origin: Vector,
        direction: Vector,
        failed: tuple[Tensor, int],
        *more: tuple[Tensor, int],
    ) -> "Rays":
        """The rays after a stage; each (where, code) enters a failure where nothing went wrong
        before.
        """
        failure = self.failure
        for where, code in (failed, *more):
            failure = torch.where((failure == 0) & where, torch.full_like(failure, code), failure)
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
        """(..., 2) m: x and y where each ray passes the plane z = depth (...) m."""
        forward = torch.where(
            self.direction.z.abs() < 1e-9, torch.ones_like(self.direction.z), self.direction.z
        )
        point = self.origin + self.direction * ((depth - self.origin.z) / forward)
        return torch.stack([point.x, point.y], -1)

"""What every lens model is to the ray path: pixels to rays, from one point of the axis or, where
the entrance pupil moves, from several.
"""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from calib.optics.params import Param, Values
from calib.optics.rays import Rays
from calib.optics.vector import Vector

PINHOLE = tuple(Param(f"camera.{name}", "px", 1.0) for name in ("fx", "fy", "cx", "cy"))
PUPIL = tuple(Param(f"entrance_pupil.{name}", "m", 1e-3) for name in ("e2", "e4"))
"""By how much the entrance pupil moves along the axis: times the angle's square and its fourth
power, rad.
"""
PUPIL_ASIDE = tuple(Param(f"entrance_pupil.{name}", "m", 1e-3) for name in ("x2", "y2"))
"""By how much it moves across the axis, to the same side for all rays: times the angle's square."""


class Lens(Protocol):
    """Launches a ray through the entrance pupil for each pixel."""

    @property
    def params(self) -> tuple[Param, ...]: ...

    @property
    def pupil(self) -> tuple[Param, ...]:
        """What says how the entrance pupil moves; () where it keeps still."""
        ...

    @property
    def wide(self) -> bool:
        """Whether it can see more than what is in front of the pinhole."""
        ...

    def with_pupil(self, pupil: tuple[Param, ...]) -> Lens:
        """The same lens with an entrance pupil that moves so."""
        ...

    def __call__(self, pixels: Tensor, values: Values) -> Rays:
        """(..., 2) px to rays that start at the entrance pupil."""
        ...

    def project(self, points: Tensor, values: Values) -> Tensor:
        """(..., 3) m that the lens sees to (..., 2) px, as if there were no cover and the pupil
        kept still.
        """
        ...


def normalised(pixels: Tensor, values: Values) -> tuple[Tensor, Tensor]:
    """(..., 2) px to (...) x and y over the focal lengths, from the principal point on."""
    return (pixels[..., 0] - values["camera.cx"]) / values["camera.fx"], (
        pixels[..., 1] - values["camera.cy"]
    ) / values["camera.fy"]


def entrance(angle: Tensor, values: Values, pupil: tuple[Param, ...]) -> Vector:
    """(...) m where a ray at (...) rad from the axis enters the lens."""
    square, along, right, down = (
        angle**2,
        torch.zeros_like(angle),
        torch.zeros_like(angle),
        torch.zeros_like(angle),
    )
    if pupil:
        second, fourth = (values[param.name] for param in PUPIL)
        along = square * (second + square * fourth)
    if set(PUPIL_ASIDE) <= set(pupil):
        right, down = (square * values[param.name] for param in PUPIL_ASIDE)
    return Vector(right, down, along)

"""The protocol of a lens model in the ray path: it turns pixels into rays, from one point of the
axis or, if the entrance pupil moves, from several.
"""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from calib.optics.params import Param, Values
from calib.optics.rays import Rays
from calib.optics.vector import Vector
from calib.session.parameter_names import CAMERA

PINHOLE = tuple(Param(name, "px", 1.0) for name in CAMERA.pinhole)
PUPIL = tuple(Param(f"entrance_pupil.{name}", "m", 1e-3) for name in ("e2", "e4"))
"""The axial shift of the entrance pupil is e2 angle^2 + e4 angle^4, the angle in rad."""
PUPIL_LATERAL = tuple(Param(f"entrance_pupil.{name}", "m", 1e-3) for name in ("x2", "y2"))
"""The lateral shift of the entrance pupil is (x2, y2) angle^2: all rays move to the same side."""


class Lens(Protocol):
    """Launches a ray through the entrance pupil for each pixel."""

    @property
    def params(self) -> tuple[Param, ...]: ...

    @property
    def pupil(self) -> tuple[Param, ...]:
        """The parameters of the entrance pupil's motion; () if it does not move."""
        ...

    @property
    def wide(self) -> bool:
        """True if the lens can see points that are not in front of the pinhole."""
        ...

    def with_pupil(self, pupil: tuple[Param, ...]) -> Lens:
        """Return the same lens with these parameters of the entrance pupil's motion."""
        ...

    def __call__(self, pixels: Tensor, values: Values, near: Tensor | None = None, /) -> Rays:
        """Return the rays of (..., 2) px, starting at the entrance pupil.

        `near` is an estimate of each ray's direction, (..., 2) x and y at z = 1, NaN where there is
        none. A lens that inverts its distortion by iteration starts at it.
        """
        ...

    def project(self, points: Tensor, values: Values) -> Tensor:
        """Return the (..., 2) px of (..., 3) m points that the lens sees, as if there were no cover
        and the pupil did not move.
        """
        ...


def normalise_pixels(pixels: Tensor, values: Values) -> tuple[Tensor, Tensor]:
    """Return the (...) normalised x and y of (..., 2) px: offsets from the principal point, over
    the focal lengths.
    """
    x = (pixels[..., 0] - values[CAMERA.cx]) / values[CAMERA.fx]
    y = (pixels[..., 1] - values[CAMERA.cy]) / values[CAMERA.fy]
    return x, y


def entrance_point(angle: Tensor, values: Values, pupil: tuple[Param, ...]) -> Vector:
    """Return the (...) m entrance pupil of a ray at (...) rad from the axis."""
    square = angle**2
    x = torch.zeros_like(angle)
    y = torch.zeros_like(angle)
    z = torch.zeros_like(angle)
    if pupil:
        z = square * (values[PUPIL[0].name] + square * values[PUPIL[1].name])
    if set(PUPIL_LATERAL) <= set(pupil):
        x = square * values[PUPIL_LATERAL[0].name]
        y = square * values[PUPIL_LATERAL[1].name]
    return Vector(x, y, z)

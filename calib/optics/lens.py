"""The protocol of a lens model in the ray path: it turns pixels into rays, from one point of the
axis or, if the entrance pupil moves, from several.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

import torch
from torch import Tensor

from calib.optics.derivatives import ByName, ByRay, by_autograd
from calib.optics.params import Param, Values
from calib.optics.rays import Rays
from calib.optics.vector import Vector
from calib.session.parameter_names import CAMERA

PINHOLE = tuple(Param(name, "px", 1.0) for name in CAMERA.pinhole)
PUPIL = tuple(Param(f"entrance_pupil.{name}", "m", 1e-3) for name in ("e2", "e4"))
"""The axial shift of the entrance pupil is e2 angle^2 + e4 angle^4, the angle in rad."""
PUPIL_LATERAL = tuple(Param(f"entrance_pupil.{name}", "m", 1e-3) for name in ("x2", "y2"))
"""The lateral shift of the entrance pupil is (x2, y2) angle^2: all rays move to the same side."""


Pull = Callable[[ByRay], tuple[Tensor, ByName]]
"""From the derivatives of k outputs by M rays to those by their pixels (k, M, 2) and by numbers."""


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

    def launch(
        self, pixels: Tensor, values: Values, names: frozenset[str], near: Tensor | None = None, /
    ) -> tuple[Rays, Pull]:
        """Return the same rays of (M, 2) px, and their derivatives by the pixels and by the
        parameters of these names.
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


def launch_by_autograd(
    lens: Lens, pixels: Tensor, values: Values, names: Iterable[str], near: Tensor | None
) -> tuple[Rays, Pull]:
    """Return what `Lens.launch` does, differentiated by torch."""
    copies = {
        param.name: values[param.name].expand(len(pixels), *param.shape)
        if values[param.name].shape == param.shape
        else values[param.name]
        for param in lens.params
        if param.name in names
    }
    failure: list[Tensor] = []

    def rays_of(leaves: Values) -> tuple[Tensor, ...]:
        rays = lens(leaves[PIXELS], {**values, **leaves}, near)
        failure[:] = [rays.failure]
        origin, direction = rays.origin, rays.direction
        return origin.x, origin.y, origin.z, direction.x, direction.y, direction.z

    components, pull = by_autograd(rays_of, {PIXELS: pixels, **copies})

    def pull_rays(by_rays: ByRay) -> tuple[Tensor, ByName]:
        origin, direction = by_rays.origin, by_rays.direction
        by = pull((origin.x, origin.y, origin.z, direction.x, direction.y, direction.z))
        return by.pop(PIXELS), by

    return Rays(Vector(*components[:3]), Vector(*components[3:]), failure[0]), pull_rays


PIXELS = "pixels"
"""The name of the pixels among what is differentiated."""

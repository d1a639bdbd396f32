"""What every lens model is to the ray path: pixels to rays, from one point of the axis or, where the entrance pupil moves, from several."""

from __future__ import annotations

from typing import Protocol

from torch import Tensor

from calib.optics.params import Param, Values
from calib.optics.rays import Rays

PINHOLE = tuple(Param(f"camera.{name}", "px", 1.0) for name in ("fx", "fy", "cx", "cy"))
PUPIL = tuple(Param(f"entrance_pupil.{name}", "m", 1e-3) for name in ("e2", "e4"))
"""By how much the entrance pupil moves along the axis: times the angle's square and its fourth power, rad."""


class Lens(Protocol):
    """Launches a ray through the entrance pupil for each pixel."""

    @property
    def params(self) -> tuple[Param, ...]: ...

    @property
    def pupil(self) -> bool:
        """Whether the entrance pupil moves."""
        ...

    @property
    def wide(self) -> bool:
        """Whether it can see more than what is in front of the pinhole."""
        ...

    def with_pupil(self) -> Lens:
        """The same lens with an entrance pupil that moves."""
        ...

    def __call__(self, pixels: Tensor, values: Values) -> Rays:
        """(..., 2) px to rays that start at the entrance pupil."""
        ...

    def project(self, points: Tensor, values: Values) -> Tensor:
        """(..., 3) m that the lens sees to (..., 2) px, as if there were no cover and the pupil kept still."""
        ...


def normalised(pixels: Tensor, values: Values) -> tuple[Tensor, Tensor]:
    """(..., 2) px to (...) x and y over the focal lengths, from the principal point on."""
    return (pixels[..., 0] - values["camera.cx"]) / values["camera.fx"], (pixels[..., 1] - values["camera.cy"]) / values["camera.fy"]


def entrance(angle: Tensor, values: Values) -> Tensor:
    """(...) m along the axis where a ray at (...) rad from it enters the lens."""
    second, fourth = (values[param.name] for param in PUPIL)
    return angle**2 * (second + angle**2 * fourth)

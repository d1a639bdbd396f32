"""The way of a ray: the lens, then each surface of the cover in order, then the board."""

from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor
from torch.func import jvp

from calib.optics.interface import Interface
from calib.optics.lens import Lens
from calib.optics.params import Param, Values
from calib.optics.rays import Rays
from calib.optics.target import Plane


@dataclass(frozen=True, slots=True)
class Path:
    """An ordered tuple of named, frozen, pure stages (the paper's Fig. 3). Its numbers are passed to each call."""

    lens: Lens
    cover: tuple[Interface, ...] = ()
    target: Plane = field(default_factory=Plane)

    @property
    def params(self) -> tuple[Param, ...]:
        """Every number that some stage reads, once, in the order of the path."""
        read = (*self.lens.params, *(param for interface in self.cover for param in interface.params))
        return tuple({param.name: param for param in read}.values())

    def trace(self, pixels: Tensor, values: Values) -> Rays:
        """(..., 2) px to the rays that leave the cover."""
        rays = self.lens(pixels, values)
        for interface in self.cover:
            rays = interface(rays, values)
        return rays

    def land(self, pixels: Tensor, values: Values, poses: Tensor) -> tuple[Tensor, Tensor]:
        """(..., 2) px and (..., 6) board poses to (..., 2) m on the board and (...) uint8 failures."""
        return self.target(self.trace(pixels, values), poses)


def by_pixel(function: Callable[[Tensor], tuple[Tensor, Tensor]], pixels: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Differentiate a function of (..., 2) px row by row.

    Args:
        function: gives a (..., k) value and anything else that is not differentiated.

    Returns:
        The (..., k) value, its (..., k, 2) derivative by the pixel, and the function's second result.
    """
    columns = []
    for axis in range(2):
        tangent = torch.zeros_like(pixels)
        tangent[..., axis] = 1
        value, column, other = jvp(function, (pixels,), (tangent,), has_aux=True)  # type: ignore[misc]
        columns.append(column)
    return value, torch.stack(columns, -1), other

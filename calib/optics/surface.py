"""What the ray path asks of a cover's shape. One file per shape; each works in the cover's own frame."""

from typing import Protocol

from torch import Tensor

from calib.optics.params import Param, Values


class Surface(Protocol):
    """A family of surfaces: the inner one at height 0, the outer one at the height of the cover's thickness.

    `height` is measured along the direction in which the cover's thickness is (the radius of a cone), from the inner surface
    outwards, so an uneven outer surface is height = thickness + relief.
    """

    @property
    def params(self) -> tuple[Param, ...]:
        """The numbers that it reads from the values."""
        ...

    def reach(self, origin: Tensor, direction: Tensor, height: Tensor, values: Values) -> tuple[Tensor, Tensor]:
        """From (..., 3) m and (..., 3) unit, inside, to the surface at `height` m: (...) m along the ray, (...) bool missed."""
        ...

    def height(self, points: Tensor, values: Values) -> Tensor:
        """(..., 3) m to (...) m above the inner surface."""
        ...

    def gradient(self, points: Tensor, values: Values) -> Tensor:
        """(..., 3): the derivative of `height` by the point. It points outwards; its length need not be one."""
        ...

    def chart(self, points: Tensor) -> Tensor:
        """(..., 3) m to (..., 2) surface coordinates, in which the relief's centres lie on a regular grid."""
        ...

    def chart_gradient(self, points: Tensor) -> Tensor:
        """(..., 2, 3): the derivative of `chart` by the point."""
        ...

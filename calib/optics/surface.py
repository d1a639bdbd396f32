"""The shape of a cover as the ray path asks for it, in the cover's own frame: intersection, height,
normal, and a chart for the relief.

A new shape is a file with a class of this protocol, and a case in `optics.build`.
"""

from typing import Protocol

from torch import Tensor

from calib.optics.params import Param, Values
from calib.optics.vector import Vector


class Surface(Protocol):
    """A family of surfaces: the inner one at height 0, the outer one at the height of the cover's
    thickness.

    `height` is measured along the direction in which the cover's thickness is (the radius of a
    cone), from the inner surface outwards, so an uneven outer surface is height = thickness +
    relief.
    """

    @property
    def params(self) -> tuple[Param, ...]:
        """The parameters that it reads from the values."""
        ...

    def reach(
        self, origin: Vector, direction: Vector, height: Tensor, values: Values
    ) -> tuple[Tensor, Tensor]:
        """From a point inside, along a unit direction, to the surface at `height` m: (...) m along
        the ray, (...) bool missed.
        """
        ...

    def height(self, points: Vector, values: Values) -> Tensor:
        """(...) m above the inner surface."""
        ...

    def gradient(self, points: Vector, values: Values) -> Vector:
        """The derivative of `height` by the point. It points outwards; its length need not be
        one.
        """
        ...

    def chart(self, points: Vector) -> tuple[Tensor, Tensor]:
        """The two (...) surface coordinates in which the relief's centres lie on a regular grid."""
        ...

    def chart_gradient(self, points: Vector, first: Tensor, second: Tensor) -> Vector:
        """first times the derivative of the first chart coordinate by the point, plus second times
        that of the second.
        """
        ...

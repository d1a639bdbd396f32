"""The protocol of a cover's shape, in the cover's own frame: intersection, height, normal, and a
chart for the relief.

The description of a shape (`calib.session.shapes`) names its class of this protocol.
"""

from typing import ClassVar, Protocol

from torch import Tensor

from calib.optics.derivatives import ByName
from calib.optics.params import Param, Values
from calib.optics.vector import Vector
from calib.session.parameter_names import CoverNames


class Surface(Protocol):
    """A family of surfaces: the inner one at height 0, the outer one at the height of the cover's
    thickness.

    `height` is measured outwards from the inner surface, in the direction in which the thickness is
    measured (along the radius of a cone). So an uneven outer surface is height = thickness +
    relief.
    """

    symmetry: ClassVar[str]
    """The axes of the cover's frame about which a turn leaves the smooth surface as it is: y for a
    cone, xyz for a dome.
    """

    @property
    def names(self) -> CoverNames:
        """The names of the cover's numbers."""
        ...

    @property
    def params(self) -> tuple[Param, ...]:
        """The parameters that the surface reads from the values."""
        ...

    def reach(
        self, origin: Vector, direction: Vector, height: Tensor, values: Values
    ) -> tuple[Tensor, Tensor]:
        """Intersect rays from a point inside, along a unit direction, with the surface at `height`
        m: return the (...) m distance along each ray, and (...) bool, true where it misses.
        """
        ...

    def height(self, points: Vector, values: Values) -> Tensor:
        """Return the (...) m height of points above the inner surface."""
        ...

    def gradient(self, points: Vector, values: Values) -> Vector:
        """Return the derivative of `height` by the point. It points outwards; its length need not
        be one.
        """
        ...

    def chart(self, points: Vector) -> tuple[Tensor, Tensor]:
        """Return the two (...) surface coordinates in which the relief's centres form a regular
        grid.
        """
        ...

    def chart_gradient(self, points: Vector, first: Tensor, second: Tensor) -> Vector:
        """Return `first` times the derivative of the first chart coordinate by the point, plus
        `second` times the derivative of the second chart coordinate.
        """
        ...

    def curvature(self, points: Vector, step: Vector, values: Values) -> Vector:
        """Return the (...) change of `gradient` along vectors, to first order."""
        ...

    def by_parameters(
        self, points: Vector, by_height: Tensor, by_gradient: Vector, values: Values
    ) -> ByName:
        """Return the derivatives by the parameters, from those by `height` and by `gradient`."""
        ...

    def chart_change(self, points: Vector, step: Vector) -> tuple[Tensor, Tensor]:
        """Return the (...) changes of the two chart coordinates along vectors, to first order."""
        ...

    def chart_curvature(
        self, points: Vector, first: Tensor, second: Tensor, step: Vector
    ) -> Vector:
        """Return the (...) change of `chart_gradient` along vectors, to first order."""
        ...

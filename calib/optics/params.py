"""The parameters of a ray path: names, units and scales; and `Values`, the mapping from names to
tensors that every stage reads.

A stage of the path (lens, interface, board) declares the parameters that it reads as a tuple of
`Param`, and is a pure function of its rays and the values, so that a fit can differentiate by any
of them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from torch import Tensor

Values = Mapping[str, Tensor]
"""Every value of a ray path by name, in SI units and pixels: () for a scalar, (rows, columns) for a
relief's amplitudes. A scalar may also be a (...) tensor with a value for each ray.
"""


@dataclass(frozen=True, slots=True)
class Param:
    """A number that a stage reads from the values. A solver sees value / scale."""

    name: str
    unit: str
    scale: float
    """The size of a typical change, in the unit."""
    shape: tuple[int, ...] = ()
    """The shape of the value: () for a scalar."""
    minimum: float = -math.inf
    """The smallest value that is physically possible, in the unit."""

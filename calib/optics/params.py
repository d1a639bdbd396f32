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
relief's amplitudes. Of a scalar there may also be one for each ray, (...).
"""

TIME = "seen.time"
LINE = "seen.line"
"""Optional values, (...) each: when each ray was seen, in the session and during its picture's
readout, both from -0.5 to 0.5. Without them it was in the middle.
"""
NEAR = "lens.near"
"""Optional, (..., 2): about where each ray goes, x, y at z = 1, NaN where that is not known: a lens
that searches for rays begins there.
"""


@dataclass(frozen=True, slots=True)
class Param:
    """A number that a stage reads from the values. A solver sees value / scale."""

    name: str
    unit: str
    scale: float
    """The size of a typical change, in the unit."""
    shape: tuple[int, ...] = ()
    """Of the value: () for a scalar."""
    least: float = -math.inf
    """Below it there is no such thing."""

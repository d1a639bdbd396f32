"""What a number of the model is called, what it is measured in, and how large a typical change of it is."""

from collections.abc import Mapping
from dataclasses import dataclass

from torch import Tensor

Values = Mapping[str, Tensor]
"""Every number of a ray path by name, in SI units and pixels: () for a scalar, (rows, columns) for a relief's amplitudes."""


@dataclass(frozen=True, slots=True)
class Param:
    """A number that a stage reads from the values. A solver sees value / scale."""

    name: str
    unit: str
    scale: float
    """The size of a typical change, in the unit."""

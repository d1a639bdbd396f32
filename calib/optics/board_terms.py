"""The differences of a board from a flat one with evenly printed corners: bends of its surface, and
shifts of its corners.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from torch import Tensor

from calib.optics.params import Param, Values


class Bend(Protocol):
    """A deviation of the board's surface from a plane."""

    @property
    def params(self) -> tuple[Param, ...]: ...

    def height(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor, Tensor]:
        """Return the (...) m height at (...) m board coordinates, positive away from the camera,
        and its slopes by x and by y. Nobody differentiates the slopes.
        """
        ...


class Print(Protocol):
    """A shift of the printed corners within the board's plane."""

    @property
    def params(self) -> tuple[Param, ...]: ...

    def shift_corners(self, x: Tensor, y: Tensor, values: Values) -> PrintShift:
        """Return the shifts of the corners at (...) m nominal board coordinates."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PrintShift:
    """Shifts of corners within the board's plane."""

    shift_x: Tensor
    """(...) m, along x."""
    shift_y: Tensor
    """(...) m, along y."""
    slopes: tuple[tuple[Tensor | float, Tensor | float], tuple[Tensor | float, Tensor | float]]
    """The (...) derivatives of `shift_x` by x and y, then of `shift_y` by x and y. Nobody
    differentiates them.
    """

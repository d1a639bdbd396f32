"""The print is longer in one direction than in the other, and its directions may not be at right angles. What both directions share is the
board's size, which no view can tell."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.effect import Effect, Surroundings, Unknown, most_evident
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.tolerances import PRINT_SHEAR, PRINT_STRETCH

STRETCH = Unknown.of("board_scale.x_over_y", PRINT_STRETCH)
SHEAR = Unknown.of("board_scale.shear", PRINT_SHEAR)


@dataclass(frozen=True, slots=True)
class BoardScale(Effect):
    """x is longer by half of the stretch, and y shorter by half of it; of a print that is sheared, each direction is turned towards the
    other by half of the angle."""

    sheared: bool = False
    name: ClassVar[str] = "board_scale"
    about: ClassVar[str] = "the board"
    advice: ClassVar[str] = "turn the board by 90 degrees in half of the views"

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        del there
        return (cls(sheared=True),)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return (STRETCH, SHEAR) if self.sheared else (STRETCH,)

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(unknown.param for unknown in self.unknowns)

    def alternatives(self) -> tuple[Self, ...]:
        return replace(self, sheared=False), replace(self, sheared=True)

    def tuned(self, information: NDArray[np.float64], score: NDArray[np.float64]) -> Self:
        """With the larger evidence, to first order."""
        return most_evident([form for form in self.alternatives() if form.sheared <= self.sheared], information, score)

    def apply(self, path: Path) -> Path:
        return replace(path, target=replace(path.target, prints=(*path.target.prints, self)))

    def shift(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor]:
        """(...) m by which a corner is moved."""
        half = values[STRETCH.param.name] / 2
        right, down = half * x, -half * y
        if self.sheared:
            turned = values[SHEAR.param.name] / 2
            right, down = right + turned * y, down + turned * x
        return right, down

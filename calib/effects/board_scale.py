"""The print is longer in one direction than in the other. What both directions share is the board's size, which no view can tell."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from torch import Tensor

from calib.effects.effect import Effect, Surroundings, Unknown
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.tolerances import PRINT_STRETCH

STRETCH = Unknown.of("board_scale.x_over_y", PRINT_STRETCH)


@dataclass(frozen=True, slots=True)
class BoardScale(Effect):
    """x is longer by half of the stretch, and y shorter by half of it."""

    name: ClassVar[str] = "board_scale"
    about: ClassVar[str] = "the board"
    advice: ClassVar[str] = "turn the board by 90 degrees in half of the views"

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        del there
        return (cls(),)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return (STRETCH,)

    @property
    def params(self) -> tuple[Param, ...]:
        return (STRETCH.param,)

    def apply(self, path: Path) -> Path:
        return replace(path, target=replace(path.target, prints=(*path.target.prints, self)))

    def shift(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor]:
        """(...) m by which a corner is moved."""
        half = values[STRETCH.param.name] / 2
        return half * x, -half * y

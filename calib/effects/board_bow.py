"""The board is not flat: it bows like a shallow dish. The form is mrcal's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from torch import Tensor

from calib.effects.effect import Effect, Surroundings, Unknown
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.tolerances import BOARD_BOW

UNKNOWNS = tuple(Unknown.of(f"board_bow.{axis}", BOARD_BOW) for axis in "xy")
X, Y = (unknown.param for unknown in UNKNOWNS)


@dataclass(frozen=True, slots=True)
class BoardBow(Effect):
    """z = bow.x (1 - (x / half_x)^2) + bow.y (1 - (y / half_y)^2): by how much the middle is farther from the camera than the edges."""

    half_x: float
    """m, half the distance between the outermost corners along x."""
    half_y: float
    name: ClassVar[str] = "board_bow"
    advice: ClassVar[str] = (
        "tilt the board by 40 degrees and more, in both directions, so that its middle and its edges lie at different depths"
    )

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return (cls(*there.board.half),)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return UNKNOWNS

    @property
    def params(self) -> tuple[Param, ...]:
        return X, Y

    def apply(self, path: Path) -> Path:
        return replace(path, target=replace(path.target, bends=(*path.target.bends, self)))

    def height(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor, Tensor]:
        """(...) m away from the camera, and its slopes."""
        along, down = values[X.name], values[Y.name]
        u, v = x / self.half_x, y / self.half_y
        return along * (1 - u * u) + down * (1 - v * v), -2 * along * u / self.half_x, -2 * down * v / self.half_y

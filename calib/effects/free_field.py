"""An effect without a name: a smooth free-form displacement over the board."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from torch import Tensor

from calib.effects.cosine_field import FIRST_KNEE, CosineField
from calib.effects.effect import Surroundings
from calib.optics.board_target import PrintShift
from calib.optics.params import Values
from calib.optics.path import Path


@dataclass(frozen=True, slots=True)
class FreeField(CosineField):
    """Corners are printed elsewhere than on their grid."""

    name: ClassVar[str] = "free_field"
    about: ClassVar[str] = "the board"
    has_cause: ClassVar[bool] = False
    advice: ClassVar[str] = (
        "turn the board by 90 degrees in some views, and move it over the whole picture"
    )
    area: ClassVar[str] = "free_field.board"
    unit: ClassVar[str] = "m"
    scale: ClassVar[float] = 1e-5
    first_size: ClassVar[float] = 2e-4

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        right, down = (half + there.board.square / 2 for half in there.board.half)
        return (cls((-right, -down), (right, down), cls.first_size, FIRST_KNEE),)

    def apply(self, path: Path) -> Path:
        return replace(path, target=replace(path.target, prints=(*path.target.prints, self)))

    def shift_corners(self, x: Tensor, y: Tensor, values: Values) -> PrintShift:
        """Where nominal board coordinates are."""
        (across, *by_across), (down, *by_down) = self.shift(x, y, values)
        return PrintShift(across, down, ((by_across[0], by_across[1]), (by_down[0], by_down[1])))

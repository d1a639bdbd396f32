"""An error without a named cause: a smooth free-form displacement over the board."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from torch import Tensor

from calib.effects.cosine_field import FIRST_KNEE, CosineField
from calib.effects.effect import EffectContext
from calib.optics.board_terms import PrintShift
from calib.optics.params import Values
from calib.optics.path import Path


@dataclass(frozen=True, slots=True)
class FreeField(CosineField):
    """A displacement of the printed corners from their grid."""

    name: ClassVar[str] = "free_field"
    description: ClassVar[str] = (
        "An error without a named cause displaces the corners smoothly over the board."
    )
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
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        if not context.board.is_flat:
            return ()
        x = context.board.half[0] + context.board.square / 2
        y = context.board.half[1] + context.board.square / 2
        return (cls((-x, -y), (x, y), cls.first_size, FIRST_KNEE),)

    def apply(self, path: Path) -> Path:
        return replace(path, target=replace(path.target, prints=(*path.target.prints, self)))

    def shift_corners(self, x: Tensor, y: Tensor, values: Values) -> PrintShift:
        """Return the shifts of corners at nominal board coordinates."""
        shifts = self.shift(x, y, values)
        shift_x, x_by_x, x_by_y = shifts[0]
        shift_y, y_by_x, y_by_y = shifts[1]
        return PrintShift(shift_x, shift_y, ((x_by_x, x_by_y), (y_by_x, y_by_y)))

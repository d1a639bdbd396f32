"""The lens distorts otherwise than any polynomial says: a smooth free-form displacement over the
image, of a camera that stays central.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import torch
from torch import Tensor

from calib.effects.cosine_field import FIRST_KNEE, CosineField
from calib.effects.effect import Surroundings
from calib.optics.linear_term import with_slopes
from calib.optics.params import Values
from calib.optics.path import Path


@dataclass(frozen=True, slots=True)
class LensField(CosineField):
    """Pixels are moved before the lens that the session states."""

    name: ClassVar[str] = "lens_field"
    about: ClassVar[str] = "the lens"
    advice: ClassVar[str] = (
        "move the board over the whole picture, near and far, and turn it by 90 degrees in some"
        " views"
    )
    area: ClassVar[str] = "lens_field"
    unit: ClassVar[str] = "px"
    scale: ClassVar[float] = 0.1
    first_size: ClassVar[float] = 0.5

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return (
            cls((-0.5, -0.5), (there.width - 0.5, there.height - 0.5), cls.first_size, FIRST_KNEE),
        )

    def apply(self, path: Path) -> Path:
        return replace(path, adjustments=(*path.adjustments, self))

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        x, y = pixels.unbind(-1)
        moved = [
            with_slopes(size, x, y, by_x, by_y) for size, by_x, by_y in self.shift(x, y, values)
        ]
        return pixels + torch.stack(moved, -1), values

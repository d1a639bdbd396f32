"""The lens's distortion differs from any polynomial: a smooth free-form displacement over the
image. The camera stays central.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import torch
from torch import Tensor

from calib.effects.cosine_field import FIRST_KNEE, CosineField
from calib.effects.effect import EffectContext
from calib.optics.exposure import Exposure
from calib.optics.linear_term import with_slopes
from calib.optics.params import Values
from calib.optics.path import Path


@dataclass(frozen=True, slots=True)
class LensField(CosineField):
    """A displacement of the pixels in front of the stated lens."""

    name: ClassVar[str] = "lens_field"
    description: ClassVar[str] = "The lens's distortion differs from any polynomial."
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
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        return (
            cls(
                (-0.5, -0.5),
                (context.width - 0.5, context.height - 0.5),
                cls.first_size,
                FIRST_KNEE,
            ),
        )

    def apply(self, path: Path) -> Path:
        return replace(path, adjustments=(*path.adjustments, self))

    def __call__(
        self, pixels: Tensor, values: Values, _exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]:
        x, y = pixels.unbind(-1)
        shifts = [
            with_slopes(shift, x, y, by_x, by_y) for shift, by_x, by_y in self.shift(x, y, values)
        ]
        return pixels + torch.stack(shifts, -1), values

"""The pictures are cut from, or scaled by, the sensor otherwise than those of the calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import torch
from torch import Tensor

from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.params import Param, Values
from calib.optics.path import Path

SCALES = (1 / 3, 0.5, 2 / 3, 0.75, 0.8, 1.25, 4 / 3, 1.5, 2.0, 3.0)
"""By which cameras' modes differ: pixels of one for each of another."""


@dataclass(frozen=True, slots=True)
class PictureMode(Effect):
    """A pixel p of these pictures is the calibration's middle + exp(log_scale) (p - middle) +
    shift: cropped, binned or zoomed pictures, the lens and the cover as they were.
    """

    width: int
    height: int
    name: ClassVar[str] = "picture_mode"
    about: ClassVar[str] = "the camera's mode"
    advice: ClassVar[str] = "read the mode from the camera's driver"

    @classmethod
    def propose(cls, there: EffectContext) -> tuple[Self, ...]:
        return (cls(there.width, there.height),)

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        scale = EffectParameter(Param("picture_mode.log_scale", "", 1e-3), 0.5)
        return (
            scale,
            *(
                EffectParameter(Param(f"picture_mode.shift.{axis}", "px", 1.0), 0.1 * self.width)
                for axis in "xy"
            ),
        )

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(unknown.param for unknown in self.effect_parameters)

    def apply(self, path: Path) -> Path:
        return replace(path, adjustments=(self, *path.adjustments))

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        scale, across, down = (values[param.name] for param in self.params)
        x, y = pixels.unbind(-1)
        middle_x, middle_y = (self.width - 1) / 2, (self.height - 1) / 2
        grown = scale.exp()
        moved = middle_x + grown * (x - middle_x) + across, middle_y + grown * (y - middle_y) + down
        return torch.stack(moved, -1), values

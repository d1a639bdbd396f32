"""The change that the pictures come from another mode of the sensor: cropped, binned or zoomed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import torch
from torch import Tensor

from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.exposure import Exposure
from calib.optics.params import Param, Values
from calib.optics.path import Path

SCALES = (1 / 3, 0.5, 2 / 3, 0.75, 0.8, 1.25, 4 / 3, 1.5, 2.0, 3.0)
"""Usual ratios between the pixel sizes of two modes of a camera."""


@dataclass(frozen=True, slots=True)
class PictureMode(Effect):
    """Another mode: pixel p of these pictures is pixel middle + exp(log_scale) (p - middle) + shift
    of the calibration. Lens and cover have not changed.
    """

    width: int
    height: int
    name: ClassVar[str] = "picture_mode"
    description: ClassVar[str] = "The pictures come from another mode of the camera."
    about: ClassVar[str] = "the camera's mode"
    advice: ClassVar[str] = "read the mode from the camera's driver"

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        return (cls(context.width, context.height),)

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

    def __call__(
        self, pixels: Tensor, values: Values, _exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]:
        scale = values["picture_mode.log_scale"]
        shift_x = values["picture_mode.shift.x"]
        shift_y = values["picture_mode.shift.y"]
        x, y = pixels.unbind(-1)
        middle_x = (self.width - 1) / 2
        middle_y = (self.height - 1) / 2
        factor = scale.exp()
        mapped_x = middle_x + factor * (x - middle_x) + shift_x
        mapped_y = middle_y + factor * (y - middle_y) + shift_y
        return torch.stack((mapped_x, mapped_y), -1), values

"""The changes that the pictures come from another mode of the sensor: cropped, binned or zoomed, or
stretched.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, log
from typing import ClassVar, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.exposure import Exposure
from calib.optics.params import Param, Values
from calib.optics.path import Path

SCALES = (1 / 3, 0.5, 2 / 3, 0.75, 0.8, 1.25, 4 / 3, 1.5, 2.0, 3.0)
"""Usual ratios between the pixel sizes of two modes of a camera."""
STRETCHES = (0.5, 9 / 16, 3 / 4, 8 / 9, 9 / 8, 4 / 3, 16 / 9, 2.0)
"""Usual ratios of a pixel's width to its height: of a wide picture in a 4:3 one, of television's
pixels, of a sensor that skips lines.
"""


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

    def starts(self) -> tuple[tuple[float, dict[str, float]], ...]:
        """Return initial values to try, each with the ratio of a pixel's side in the two modes."""
        return tuple((factor, {"picture_mode.log_scale": log(factor)}) for factor in SCALES)

    def size(self, vector: NDArray[np.float64]) -> tuple[float, EffectParameter]:
        """Return the figure that names the mode, the pixels of these pictures per pixel of the
        calibration, and the parameter whose uncertainty it has.

        Args:
            vector: (k,) the parameters over their scales.
        """
        scale = self.effect_parameters[0]
        return exp(-vector[0] * scale.param.scale), scale

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


@dataclass(frozen=True, slots=True)
class StretchedMode(PictureMode):
    """Another mode whose pixels are not square: the scale of a `PictureMode` down the picture, and
    exp(log_stretch) times as much across it.
    """

    name: ClassVar[str] = "stretched_mode"
    description: ClassVar[str] = "The pictures come from a mode of the camera that stretches them."

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        stretch = EffectParameter(Param("stretched_mode.log_stretch", "", 1e-3), 0.5)
        return stretch, *PictureMode(self.width, self.height).effect_parameters

    def starts(self) -> tuple[tuple[float, dict[str, float]], ...]:
        """Return initial values to try: one of the picture's two sides is as in the calibration."""
        stretched = tuple(
            (ratio**0.5, {"stretched_mode.log_stretch": log(ratio)}) for ratio in STRETCHES
        )
        squeezed = tuple(
            (ratio**-0.5, {**start, "picture_mode.log_scale": -log(ratio)})
            for ratio, (_, start) in zip(STRETCHES, stretched, strict=True)
        )
        return stretched + squeezed

    def size(self, vector: NDArray[np.float64]) -> tuple[float, EffectParameter]:
        """Return the width of a pixel over its height, both of the calibration's pixels, and the
        parameter whose uncertainty it has.
        """
        stretch = self.effect_parameters[0]
        return exp(vector[0] * stretch.param.scale), stretch

    def __call__(
        self, pixels: Tensor, values: Values, exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]:
        stretch = values["stretched_mode.log_stretch"].exp()
        x, y = pixels.unbind(-1)
        middle = (self.width - 1) / 2
        stretched = torch.stack((middle + stretch * (x - middle), y), -1)
        return PictureMode.__call__(self, stretched, values, exposure)

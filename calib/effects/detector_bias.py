"""The detector draws corners towards the middle of a pixel, or away from it."""

from dataclasses import dataclass
from math import tau
from typing import ClassVar

import torch
from torch import Tensor

from calib.effects.camera_numbers import CameraEffect
from calib.effects.effect import Unknown
from calib.optics.params import Param, Values

X, Y = (Param(f"detector_bias.{axis}", "px", 0.01) for axis in "xy")


@dataclass(frozen=True, slots=True)
class DetectorBias(CameraEffect):
    """A corner was seen too far right by -bias sin(2 pi x), x its place in px: with a positive bias, pulled to the middle of a pixel."""

    name: ClassVar[str] = "detector_bias"
    unknowns_: ClassVar[tuple[Unknown, ...]] = (Unknown(X, 0.1), Unknown(Y, 0.1))

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        pulled = torch.sin(tau * pixels)
        return pixels + torch.stack([values[X.name] * pulled[..., 0], values[Y.name] * pulled[..., 1]], -1), values

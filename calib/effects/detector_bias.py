"""The detector draws corners towards the middle of a pixel, or away from it."""

from dataclasses import dataclass
from math import tau
from typing import ClassVar

import torch
from torch import Tensor

from calib.effects.camera_effect import CameraEffect
from calib.effects.effect import Unknown
from calib.optics.params import Values
from calib.session.tolerances import DETECTOR

UNKNOWNS = tuple(Unknown.of(f"detector_bias.{axis}", DETECTOR) for axis in "xy")
X, Y = (unknown.param for unknown in UNKNOWNS)


@dataclass(frozen=True, slots=True)
class DetectorBias(CameraEffect):
    """A corner was seen too far right by -bias sin(2 pi x), x its place in px: with a positive
    bias, pulled to the middle of a pixel.
    """

    name: ClassVar[str] = "detector_bias"
    about: ClassVar[str] = "the corners' detector"
    advice: ClassVar[str] = "take sharper pictures, at a higher resolution"
    unknowns_: ClassVar[tuple[Unknown, ...]] = UNKNOWNS

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        wave = torch.sin(tau * pixels)
        return (
            pixels
            + torch.stack([values[X.name] * wave[..., 0], values[Y.name] * wave[..., 1]], -1),
            values,
        )

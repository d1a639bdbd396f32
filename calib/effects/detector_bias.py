"""The detector moves corners towards the middle of a pixel, or away from it."""

from dataclasses import dataclass
from math import tau
from typing import ClassVar

import torch
from torch import Tensor

from calib.effects.camera_effect import CameraEffect
from calib.effects.effect import EffectParameter
from calib.optics.exposure import Exposure
from calib.optics.params import Values
from calib.session.tolerances import DETECTOR

UNKNOWNS = tuple(EffectParameter.of(f"detector_bias.{axis}", DETECTOR) for axis in "xy")
X = UNKNOWNS[0].param
Y = UNKNOWNS[1].param


@dataclass(frozen=True, slots=True)
class DetectorBias(CameraEffect):
    """A bias of -bias sin(2 pi x) in px of a corner whose coordinate is x in px, along each
    direction: a positive bias moves corners towards the middle of a pixel.
    """

    name: ClassVar[str] = "detector_bias"
    description: ClassVar[str] = (
        "The detector moves corners towards the middle of a pixel, or away from it."
    )
    about: ClassVar[str] = "the corners' detector"
    advice: ClassVar[str] = "take sharper pictures, at a higher resolution"
    camera_parameters: ClassVar[tuple[EffectParameter, ...]] = UNKNOWNS

    def __call__(
        self, pixels: Tensor, values: Values, _exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]:
        wave = torch.sin(tau * pixels)
        return (
            pixels
            + torch.stack([values[X.name] * wave[..., 0], values[Y.name] * wave[..., 1]], -1),
            values,
        )

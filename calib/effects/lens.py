"""The distortion of the lens differs from the fitted one: Brown's radial and tangential terms, from
the distorted to the undistorted pixel.

Source: D. C. Brown, Close-range camera calibration (1971).
"""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from calib.effects.camera_effect import CameraEffect
from calib.effects.effect import EffectParameter
from calib.optics.exposure import Exposure
from calib.optics.lens import normalise_pixels
from calib.optics.params import Values
from calib.session.parameter_names import CAMERA
from calib.session.tolerances import RADIAL, TANGENTIAL

UNKNOWNS = (
    *(EffectParameter.of(f"lens.{name}", RADIAL) for name in ("k1", "k2", "k3")),
    *(EffectParameter.of(f"lens.{name}", TANGENTIAL) for name in ("p1", "p2")),
)


@dataclass(frozen=True, slots=True)
class LensEffect(CameraEffect):
    """A shift of the pixels in front of the stated lens."""

    name: ClassVar[str] = "lens"
    description: ClassVar[str] = "The distortion of the lens differs from the fitted one."
    is_sum: ClassVar[bool] = True
    about: ClassVar[str] = "the lens"
    advice: ClassVar[str] = (
        "take pictures without the cover (bare/), and boards at very different depths"
    )
    camera_parameters: ClassVar[tuple[EffectParameter, ...]] = UNKNOWNS

    def __call__(
        self, pixels: Tensor, values: Values, _exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]:
        coefficients = (values[number.param.name] for number in UNKNOWNS)
        return pixels + brown_shift(pixels, values, *coefficients), values


def brown_shift(
    pixels: Tensor,
    values: Values,
    k1: Tensor,
    k2: Tensor | float = 0.0,
    k3: Tensor | float = 0.0,
    p1: Tensor | float = 0.0,
    p2: Tensor | float = 0.0,
) -> Tensor:
    """Return the (..., 2) px by which Brown's terms move (..., 2) px."""
    x, y = normalise_pixels(pixels, values)
    r2 = x * x + y * y
    gain = r2 * (k1 + r2 * (k2 + r2 * k3))
    shift_x = x * gain + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    shift_y = y * gain + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return torch.stack([values[CAMERA.fx] * shift_x, values[CAMERA.fy] * shift_y], -1)

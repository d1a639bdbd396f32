"""The lens distorts otherwise than stated: Brown's radial and tangential terms, from the distorted
to the undistorted pixel.

Source: D. C. Brown, Close-range camera calibration (1971).
"""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from calib.effects.camera_effect import CameraEffect
from calib.effects.effect import Unknown
from calib.optics.params import Values
from calib.session.tolerances import RADIAL, TANGENTIAL

UNKNOWNS = (
    *(Unknown.of(f"lens.{name}", RADIAL) for name in ("k1", "k2", "k3")),
    *(Unknown.of(f"lens.{name}", TANGENTIAL) for name in ("p1", "p2")),
)


@dataclass(frozen=True, slots=True)
class Lens(CameraEffect):
    """Pixels are moved before the lens that the session states."""

    name: ClassVar[str] = "lens"
    about: ClassVar[str] = "the lens"
    advice: ClassVar[str] = (
        "take pictures without the cover (bare/), and boards at very different depths"
    )
    unknowns_: ClassVar[tuple[Unknown, ...]] = UNKNOWNS

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        fx, fy, cx, cy = (values[f"camera.{name}"] for name in ("fx", "fy", "cx", "cy"))
        k1, k2, k3, p1, p2 = (values[unknown.param.name] for unknown in UNKNOWNS)
        x, y = (pixels[..., 0] - cx) / fx, (pixels[..., 1] - cy) / fy
        r2 = x * x + y * y
        gain = r2 * (k1 + r2 * (k2 + r2 * k3))
        right = x * gain + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        down = y * gain + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return pixels + torch.stack([fx * right, fy * down], -1), values

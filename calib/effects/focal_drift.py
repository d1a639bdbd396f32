"""The focal length changes over the session, as a lens does that warms up."""

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from calib.effects.camera_numbers import CameraEffect
from calib.effects.effect import Unknown
from calib.effects.focal import scaled
from calib.optics.params import TIME, Param, Values

DRIFT = Param("focal_drift.over_session", "", 1e-3)


@dataclass(frozen=True, slots=True)
class FocalDrift(CameraEffect):
    """By this fraction from the first picture to the last, evenly in time; in the middle it is as stated."""

    name: ClassVar[str] = "focal_drift"
    unknowns_: ClassVar[tuple[Unknown, ...]] = (Unknown(DRIFT, 0.02),)

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        return pixels, scaled(values, 1 + values[DRIFT.name] * values[TIME]) if TIME in values else values

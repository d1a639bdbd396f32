"""The principal point is not as stated."""

from dataclasses import dataclass
from typing import ClassVar, Self

from torch import Tensor

from calib.effects.camera_effect import CameraEffect
from calib.effects.effect import Surroundings, Unknown
from calib.effects.offset import shifted
from calib.optics.params import Values
from calib.session.tolerances import PRINCIPAL_POINT

UNKNOWNS = tuple(
    Unknown.of(f"principal_point.{axis}", PRINCIPAL_POINT, (f"camera.c{axis}",)) for axis in "xy"
)


@dataclass(frozen=True, slots=True)
class PrincipalPoint(CameraEffect):
    """It lies this much farther right and farther down."""

    name: ClassVar[str] = "principal_point"
    about: ClassVar[str] = "the lens"
    advice: ClassVar[str] = "turn the camera, or the board, by 90 degrees in some views"
    unknowns_: ClassVar[tuple[Unknown, ...]] = UNKNOWNS

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return () if {"camera.cx", "camera.cy"} & there.estimated else (cls(),)

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        return pixels, shifted(values, UNKNOWNS)

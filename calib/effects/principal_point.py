"""The principal point is not as stated."""

from dataclasses import dataclass
from typing import ClassVar, Self

from torch import Tensor

from calib.effects.camera_numbers import CameraEffect
from calib.effects.effect import Surroundings, Unknown
from calib.optics.params import Param, Values

X, Y = (Param(f"principal_point.{axis}", "px", 1.0) for axis in "xy")


@dataclass(frozen=True, slots=True)
class PrincipalPoint(CameraEffect):
    """It lies this much farther right and farther down."""

    name: ClassVar[str] = "principal_point"
    unknowns_: ClassVar[tuple[Unknown, ...]] = (Unknown(X, 20.0), Unknown(Y, 20.0))

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return () if {"camera.cx", "camera.cy"} & there.estimated else (cls(),)

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        return pixels, {**values, "camera.cx": values["camera.cx"] + values[X.name], "camera.cy": values["camera.cy"] + values[Y.name]}

"""The focal length is not as stated."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

from torch import Tensor

from calib.effects.camera_numbers import CameraEffect
from calib.effects.effect import Surroundings, Unknown
from calib.optics.params import Param, Values

CHANGE = Param("focal.change", "", 1e-3)


@dataclass(frozen=True, slots=True)
class Focal(CameraEffect):
    """fx and fy are larger by the same fraction."""

    name: ClassVar[str] = "focal"
    unknowns_: ClassVar[tuple[Unknown, ...]] = (Unknown(CHANGE, 0.02),)

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return () if {"camera.fx", "camera.fy"} & there.estimated else (cls(),)

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        return pixels, scaled(values, 1 + values[CHANGE.name])


def scaled(values: Values, factor: Tensor) -> Mapping[str, Tensor]:
    """The numbers of a camera whose focal lengths are longer by a factor."""
    return {**values, **{name: values[name] * factor for name in ("camera.fx", "camera.fy")}}

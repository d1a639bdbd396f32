"""The focal length is not as stated."""

from dataclasses import dataclass
from typing import ClassVar, Self

from torch import Tensor

from calib.effects.camera_effect import CameraEffect
from calib.effects.effect import Surroundings, Unknown
from calib.effects.offset import shifted
from calib.optics.params import Values
from calib.session.tolerances import FOCAL

CHANGE = Unknown.of("focal.change", FOCAL, ("camera.fx", "camera.fy"), relative=True)


@dataclass(frozen=True, slots=True)
class Focal(CameraEffect):
    """fx and fy are larger by the same fraction."""

    name: ClassVar[str] = "focal"
    about: ClassVar[str] = "the lens"
    advice: ClassVar[str] = "tilt the board, and hold it near and far"
    unknowns_: ClassVar[tuple[Unknown, ...]] = (CHANGE,)

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return () if {"camera.fx", "camera.fy"} & there.estimated else (cls(),)

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        return pixels, shifted(values, (CHANGE,))

"""The base class of effects on the camera: an adjustment of the pixels or of the camera's
parameters.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Self

from torch import Tensor

from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.exposure import Exposure
from calib.optics.params import Param, Values
from calib.optics.path import Path


@dataclass(frozen=True, slots=True)
class CameraEffect(Effect):
    """An effect that is itself an adjustment of the path."""

    name: ClassVar[str]
    description: ClassVar[str]
    about: ClassVar[str]
    camera_parameters: ClassVar[tuple[EffectParameter, ...]]

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        del context
        return (cls(),)

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return self.camera_parameters

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(parameter.param for parameter in self.effect_parameters)

    def apply(self, path: Path) -> Path:
        return replace(path, adjustments=(*path.adjustments, self))

    @abstractmethod
    def __call__(
        self, pixels: Tensor, values: Values, exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]: ...

"""The part that effects on the camera share: an adjustment of the pixels or of the camera's
parameters.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Self

from torch import Tensor

from calib.effects.effect import Effect, Surroundings, Unknown
from calib.optics.params import Param, Values
from calib.optics.path import Path


@dataclass(frozen=True, slots=True)
class CameraEffect(Effect):
    """An effect that is an adjustment itself."""

    name: ClassVar[str]
    about: ClassVar[str]
    unknowns_: ClassVar[tuple[Unknown, ...]]

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        del there
        return (cls(),)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return self.unknowns_

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(unknown.param for unknown in self.unknowns)

    def apply(self, path: Path) -> Path:
        return replace(path, adjustments=(*path.adjustments, self))

    @abstractmethod
    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]: ...

"""Effects that are numbers of the cover, held by the fit at what the session states."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import Effect, Surroundings, Unknown
from calib.effects.offset import offsets
from calib.optics.path import Path

METRE = ("m", 1e-3, 2e-3)
SLOPE = ("", 1e-2, 0.02)
"""Unit, scale, and how far a number may well be from what was stated."""


@dataclass(frozen=True, slots=True)
class CoverNumber(Effect):
    """Some numbers of the cover are not as stated."""

    numbers: tuple[str, ...]
    """Those that this cover has."""
    name: ClassVar[str]
    candidates: ClassVar[dict[str, tuple[str, float, float]]]
    """Unit, scale and sigma of every number that may be meant."""

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        read = {param.name for interface in there.path.cover for param in interface.params}
        own = tuple(name for name in cls.candidates if name in read and name not in there.estimated)
        return (cls(own),) if own else ()

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return offsets(self.name, {name: self.candidates[name] for name in self.numbers})[1]

    def apply(self, path: Path) -> Path:
        adjustment, _ = offsets(self.name, {name: self.candidates[name] for name in self.numbers})
        return replace(path, adjustments=(*path.adjustments, adjustment))

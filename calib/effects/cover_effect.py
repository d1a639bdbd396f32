"""Effects that are parameters of the cover, held by the fit at what the session states."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import Effect, Surroundings, Unknown
from calib.effects.offset import Offsets, increments
from calib.optics.path import Path
from calib.session.tolerances import Tolerance


@dataclass(frozen=True, slots=True)
class CoverEffect(Effect):
    """Some parameters of the cover are not as stated."""

    parameters: tuple[str, ...]
    """Those that this cover has."""
    name: ClassVar[str]
    about: ClassVar[str] = "the cover"
    on_cover: ClassVar[bool] = True
    candidates: ClassVar[dict[str, Tolerance]]
    """Every parameter that may be meant, and its prior around what is stated."""

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        read = {param.name for interface in there.path.cover for param in interface.params}
        own = tuple(name for name in cls.candidates if name in read and name not in there.estimated)
        return (cls(own),) if own else ()

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return increments(self.name, {name: self.candidates[name] for name in self.parameters})

    def apply(self, path: Path) -> Path:
        return replace(path, adjustments=(*path.adjustments, Offsets(self.unknowns)))

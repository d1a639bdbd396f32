"""The base class of effects that estimate parameters of the cover, which a fit otherwise holds at
the session's values.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.effects.offset import Offsets, increments
from calib.optics.path import Path
from calib.session.tolerances import Tolerance


@dataclass(frozen=True, slots=True)
class CoverEffect(Effect):
    """Some parameters of the cover differ from the session's values."""

    parameters: tuple[str, ...]
    """The candidates that this cover has."""
    name: ClassVar[str]
    description: ClassVar[str]
    about: ClassVar[str] = "the cover"
    on_cover: ClassVar[bool] = True
    candidates: ClassVar[dict[str, Tolerance]]
    """The parameters that may differ, each with its prior around the session's value."""

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        present = {param.name for interface in context.path.cover for param in interface.params}
        names = tuple(
            name for name in cls.candidates if name in present and name not in context.estimated
        )
        return (cls(names),) if names else ()

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return increments(self.name, {name: self.candidates[name] for name in self.parameters})

    def apply(self, path: Path) -> Path:
        return replace(path, adjustments=(*path.adjustments, Offsets(self.effect_parameters)))

"""The base class of effects that estimate parameters of the cover, which a fit otherwise holds at
the session's values. The dimensions of a shape (`calib.session.shapes`) name their effect.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.effects.offset import Offsets, increments
from calib.optics.path import Path
from calib.session.parameter_names import number_of
from calib.session.shapes.registry import find_dimension
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

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        read = (param.name for interface in context.path.cover for param in interface.params)
        names = tuple(
            name
            for name in dict.fromkeys(read)
            if cls.tolerance(name) and name not in context.estimated
        )
        return (cls(names),) if names else ()

    @classmethod
    def tolerance(cls, name: str) -> Tolerance | None:
        """Return the prior of the cover's number around the session's value; None if this effect
        does not change it.
        """
        dimension = find_dimension(number_of(name))
        return dimension.tolerance if dimension and dimension.effect == cls.name else None

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        tolerances = {name: self.tolerance(name) for name in self.parameters}
        return increments(self.name, {name: kind for name, kind in tolerances.items() if kind})

    def apply(self, path: Path) -> Path:
        return replace(path, adjustments=(*path.adjustments, Offsets(self.effect_parameters)))

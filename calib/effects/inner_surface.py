"""The glass's inner surface is uneven as well."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.session.tolerances import GLASS_FIGURE

CENTRES = (6, 6)


@dataclass(frozen=True, slots=True)
class InnerSurface(Effect):
    """A relief of the inner surface, over the same patch as the outer surface's but coarser. Of
    several covers, the outermost one has it.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    name: ClassVar[str] = "inner_surface"
    description: ClassVar[str] = "The glass's inner surface is uneven as well."
    about: ClassVar[str] = "the cover"
    on_cover: ClassVar[bool] = True
    advice: ClassVar[str] = (
        "hold the board as near as it fits into the picture, where parallax separates the two"
        " surfaces"
    )

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        outer = context.path.cover[-1].relief if context.path.cover else None
        return (cls(outer.low, outer.high),) if outer else ()

    @property
    def relief(self) -> Relief:
        return Relief(self.low, self.high, CENTRES, name="inner_surface")

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return tuple(EffectParameter(param, GLASS_FIGURE.sigma) for param in self.relief.params)

    def apply(self, path: Path) -> Path:
        inside = len(path.cover) - len(path.outermost)
        uneven = replace(path.cover[inside], relief=self.relief)
        return replace(path, cover=(*path.cover[:inside], uneven, *path.cover[inside + 1 :]))

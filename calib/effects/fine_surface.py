"""The outer surface is uneven on a finer scale than the relief's centres can follow, at one
place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.session.tolerances import GLASS_FIGURE

CENTRES = (13, 13)
FINER = 7
"""The density of the centres over that of the relief's centres, along each direction."""


@dataclass(frozen=True, slots=True)
class FineSurface(Effect):
    """A relief with denser centres at the place where it explains the residual best."""

    low: tuple[float, float]
    high: tuple[float, float]
    name: ClassVar[str] = "fine_surface"
    description: ClassVar[str] = (
        "The outer surface is uneven on a finer scale than the relief's centres can follow."
    )
    about: ClassVar[str] = "the cover"
    on_cover: ClassVar[bool] = True
    needs_place: ClassVar[bool] = True
    advice: ClassVar[str] = (
        "fill the place in question with corners: a board with smaller squares, or more views there"
    )

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        outer = context.path.cover[-1] if context.path.cover else None
        if outer is None or outer.relief is None or outer.extra_reliefs or context.place is None:
            return ()
        half = [
            (n - 1) / 2 * step / FINER
            for n, step in zip(CENTRES, outer.relief.spacing, strict=True)
        ]
        first, second = context.place.tolist()
        a, b = half
        return (cls((first - a, second - b), (first + a, second + b)),)

    @property
    def relief(self) -> Relief:
        return Relief(self.low, self.high, CENTRES, name="fine_surface")

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return tuple(EffectParameter(param, GLASS_FIGURE.sigma) for param in self.relief.params)

    def apply(self, path: Path) -> Path:
        *inner, outer = path.cover
        return replace(
            path, cover=(*inner, replace(outer, extra_reliefs=(*outer.extra_reliefs, self.relief)))
        )

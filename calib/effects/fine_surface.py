"""The outer surface is uneven on a finer scale than the relief's centres can follow, at one
place: a bump such as a drop, or any form.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.path import Path
from calib.optics.relief import Bump, Relief
from calib.session.tolerances import GLASS_FIGURE

CENTRES = (13, 13)
FINER = 7
"""The density of the centres over that of the relief's centres, along each direction."""
BUMP = "bump"


@dataclass(frozen=True, slots=True)
class FineSurface(Effect):
    """At the place where it explains the residual best: a relief with denser centres, or a single
    round bump.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    """Chart coordinates of the first and of the last centre; both are the place of a bump."""
    metres: tuple[float, ...] = ()
    """Of a bump: m per unit of the two chart coordinates. Empty for a relief."""
    width: float = 0.0
    """m: the width at which the fit of a bump starts, and the standard deviation of its prior."""
    name: ClassVar[str] = "fine_surface"
    description: ClassVar[str] = (
        "The outer surface is uneven on a finer scale than the centres of --grid can follow."
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
        place = context.place
        if outer is None or outer.extra_reliefs or place is None:
            return ()
        bump = cls(place.chart, place.chart, place.metres, place.width)
        if outer.relief is None:
            return (bump,)
        first, second = place.chart
        a = (CENTRES[0] - 1) / 2 * outer.relief.spacing[0] / FINER
        b = (CENTRES[1] - 1) / 2 * outer.relief.spacing[1] / FINER
        return (cls((first - a, second - b), (first + a, second + b)), bump)

    @property
    def form(self) -> str:
        return BUMP if self.metres else ""

    @property
    def judged_by_score(self) -> bool:  # type: ignore[override]
        return not self.metres  # a narrow bump is not linear in its place and width

    @property
    def relief(self) -> Relief | Bump:
        if not self.metres:
            return Relief(self.low, self.high, CENTRES, name="fine_surface")
        return Bump("fine_surface", self.low, (self.metres[0], self.metres[1]))

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        if not self.metres:
            return tuple(EffectParameter(param, GLASS_FIGURE.sigma) for param in self.relief.params)
        height, first, second, width = self.relief.params
        return (
            EffectParameter(height, GLASS_FIGURE.sigma),
            EffectParameter(first, self.width / 2),
            EffectParameter(second, self.width / 2),
            EffectParameter(width, self.width / 2, neutral=self.width),
        )

    def apply(self, path: Path) -> Path:
        *inner, outer = path.cover
        return replace(
            path, cover=(*inner, replace(outer, extra_reliefs=(*outer.extra_reliefs, self.relief)))
        )

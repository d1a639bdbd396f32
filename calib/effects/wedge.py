"""The outer surface is turned against the inner one, so the glass is thicker on one side."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.cover_tilt import axis_names, turning_axes
from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.path import Path
from calib.session.tolerances import WEDGE


@dataclass(frozen=True, slots=True)
class Wedge(Effect):
    """A rotation of the outer surface about the origin of the cover's frame."""

    axes: str
    name: ClassVar[str] = "wedge"
    description: ClassVar[str] = "The outer surface is turned against the inner one."
    about: ClassVar[str] = "the cover"
    on_cover: ClassVar[bool] = True
    advice: ClassVar[str] = (
        "hold the board as near as it fits into the picture, at its left and its right side"
    )

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        axes = turning_axes(context.path)
        return (cls(axes),) if axes else ()

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return tuple(EffectParameter.of(f"wedge.{axis}", WEDGE) for axis in self.axes)

    def apply(self, path: Path) -> Path:
        *inner, outer = path.cover
        frame = replace(
            outer.frame, extra_tilts=(*outer.frame.extra_tilts, axis_names("wedge", self.axes))
        )
        return replace(path, cover=(*inner, replace(outer, frame=frame)))

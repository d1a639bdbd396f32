"""The board bends differently in every view, as a board does that somebody holds by its rim or
leans against something.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import BLOCK_SCALES, EACH_VIEW, Effect, EffectContext, EffectParameter
from calib.optics.board_target import FLEX
from calib.optics.path import Path


@dataclass(frozen=True, slots=True)
class BoardFlex(Effect):
    """Three more parameters in every view: the bend xx (1 - u^2) + xy u v + yy (1 - v^2), which is
    added to the shape that all views share.
    """

    half_x: float
    """m, half the distance between the outermost corners along x: there u = 1."""
    half_y: float
    size: float = BLOCK_SCALES[-1]
    """The prior standard deviation of each parameter, over its largest plausible size."""
    name: ClassVar[str] = "board_flex"
    description: ClassVar[str] = "The board bends differently in every view."
    about: ClassVar[str] = "each single view"
    advice: ClassVar[str] = (
        "glue the board to something stiff, or support it in the same way in every view"
    )
    per_view: ClassVar[str] = FLEX
    varies: ClassVar[str] = EACH_VIEW

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        return () if context.path.target.flex else (cls(*context.board.half),)

    def alternatives(self) -> tuple[Self, ...]:
        return tuple(replace(self, size=size) for size in BLOCK_SCALES)

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return ()

    def apply(self, path: Path) -> Path:
        return replace(
            path,
            target=replace(path.target, flex=(self.half_x, self.half_y)),
            block_scales=(*path.block_scales, (FLEX, self.size)),
        )

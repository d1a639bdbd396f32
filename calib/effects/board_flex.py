"""The board bends differently in every view, as a board does that somebody holds by its rim or
leans against something.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import EffectContext
from calib.effects.view_effect import ViewEffect
from calib.optics.path import Path
from calib.optics.view_blocks import FLEX


@dataclass(frozen=True, slots=True)
class BoardFlex(ViewEffect):
    """Twelve more parameters in every view: a bend in the terms of `board_shape` of degrees 2 to 4,
    which is added to the shape that all views share.

    The prior of a term falls with the square of its degree, as a sheet resists curvature.
    """

    half_x: float
    """m, half the distance between the outermost corners along x: there u = 1."""
    half_y: float
    name: ClassVar[str] = "board_flex"
    description: ClassVar[str] = "The board bends differently in every view."
    advice: ClassVar[str] = (
        "glue the board to something stiff, or support it in the same way in every view"
    )
    per_view: ClassVar[str] = FLEX

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        """Points are those of a screen or of a machine, which are stiff."""
        is_stiff = not context.board.has_grid
        return () if is_stiff or context.path.target.flex else (cls(*context.board.half),)

    def apply(self, path: Path) -> Path:
        target = replace(path.target, flex=(self.half_x, self.half_y))
        return replace(self.with_prior(path), target=target)

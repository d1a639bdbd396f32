"""A screen has glass before its pixels, which bends the light once more.

Source: Snell's law. A pane of thickness t and index n shifts what is seen at the angle a by
t (tan a - sin a / sqrt(n^2 - sin^2 a)) along the screen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.front_glass import FrontGlass
from calib.optics.path import Path
from calib.session.tolerances import SCREEN_GLASS

THICKNESS = replace(EffectParameter.of("screen_glass.thickness", SCREEN_GLASS), lowest=0.0)
INDEX = 1.5
"""The index of the pane. Another index looks like another thickness: with 1.52 the same shift at 45
degrees needs a pane that is thinner by 2 per cent.
"""


@dataclass(frozen=True, slots=True)
class ScreenGlass(Effect):
    """A flat pane on the pixels of a screen, with air before it."""

    name: ClassVar[str] = "screen_glass"
    description: ClassVar[str] = "There is glass before the pixels of the screen."
    about: ClassVar[str] = "the board"
    advice: ClassVar[str] = (
        "tilt the screen by 50 degrees and more in some views, to the left and right, up and down"
    )

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        """A flat target of points may be a screen; a printed board has nothing before its print."""
        board = context.board
        return (cls(),) if board.is_flat and not board.has_grid else ()

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return (THICKNESS,)

    def apply(self, path: Path) -> Path:
        return replace(path, target=replace(path.target, glass=FrontGlass(THICKNESS.param, INDEX)))

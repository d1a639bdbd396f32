"""The board moves while the picture is read out, line after line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import BLOCK_SCALES, EACH_VIEW, Effect, EffectContext, EffectParameter
from calib.optics.board_target import MOTION
from calib.optics.path import Path


@dataclass(frozen=True, slots=True)
class RollingShutter(Effect):
    """Six more parameters in every view: the rotation and the translation of its board during one
    readout.

    The duration of the readout is not needed.
    """

    size: float = BLOCK_SCALES[-1]
    """The prior standard deviation of each parameter, over its largest plausible size."""
    name: ClassVar[str] = "rolling_shutter"
    description: ClassVar[str] = "The board moves while the picture is read out, line after line."
    about: ClassVar[str] = "each single view"
    advice: ClassVar[str] = "hold the board still, or on a tripod, for some views"
    per_view: ClassVar[str] = MOTION
    varies: ClassVar[str] = EACH_VIEW

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        global_shutter = context.shutter and not context.shutter.rolling
        return () if context.path.shutter or global_shutter else (cls(),)

    def alternatives(self) -> tuple[Self, ...]:
        return tuple(replace(self, size=size) for size in BLOCK_SCALES)

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return ()

    def apply(self, path: Path) -> Path:
        return replace(path, shutter=True, block_scales=(*path.block_scales, (MOTION, self.size)))

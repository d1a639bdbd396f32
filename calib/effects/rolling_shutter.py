"""The board moves while the picture is read out, line after line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import EffectContext
from calib.effects.view_effect import ViewEffect
from calib.optics.path import Path
from calib.optics.view_blocks import MOTION


@dataclass(frozen=True, slots=True)
class RollingShutter(ViewEffect):
    """Six more parameters in every view: the rotation and the translation of its board during one
    readout.

    The duration of the readout is not needed.
    """

    name: ClassVar[str] = "rolling_shutter"
    description: ClassVar[str] = "The board moves while the picture is read out, line after line."
    advice: ClassVar[str] = "hold the board still, or on a tripod, for some views"
    per_view: ClassVar[str] = MOTION

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        global_shutter = context.shutter and not context.shutter.rolling
        return () if context.path.shutter or global_shutter else (cls(),)

    def apply(self, path: Path) -> Path:
        return replace(self.with_prior(path), shutter=True)

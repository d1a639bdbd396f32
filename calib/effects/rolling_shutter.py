"""The board moves while the picture is read out, line after line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import SIZES, Effect, Surroundings, Unknown
from calib.optics.board_target import MOTION
from calib.optics.path import Path


@dataclass(frozen=True, slots=True)
class RollingShutter(Effect):
    """Six more parameters in every view: how far its board turns and moves during one readout.

    The readout's time is not needed.
    """

    size: float = SIZES[-1]
    """Over what is possible at most: the standard deviation of each parameter beforehand."""
    name: ClassVar[str] = "rolling_shutter"
    about: ClassVar[str] = "each single view"
    advice: ClassVar[str] = "hold the board still, or on a tripod, for some views"
    per_view: ClassVar[str] = MOTION

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        still = there.shutter and not there.shutter.rolling
        return () if there.path.shutter or still else (cls(),)

    def alternatives(self) -> tuple[Self, ...]:
        return tuple(replace(self, size=size) for size in SIZES)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return ()

    def apply(self, path: Path) -> Path:
        return replace(path, shutter=True, block_scales=(*path.block_scales, (MOTION, self.size)))

"""The board bends otherwise in every view, as one does that is held by its rim, or leans."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import SIZES, Effect, Surroundings, Unknown
from calib.optics.board_target import FLEX
from calib.optics.path import Path


@dataclass(frozen=True, slots=True)
class BoardFlex(Effect):
    """Three more parameters in every view: xx (1 - u^2) + xy u v + yy (1 - v^2), on top of the
    shape that all views share.
    """

    half_x: float
    """m, half the distance between the outermost corners along x: there u = 1."""
    half_y: float
    size: float = SIZES[-1]
    """Over what is possible at most: the standard deviation of each parameter beforehand."""
    name: ClassVar[str] = "board_flex"
    about: ClassVar[str] = "each single view"
    advice: ClassVar[str] = (
        "glue the board to something stiff, or lay it down or lean it alike in every view"
    )
    per_view: ClassVar[str] = FLEX

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return () if there.path.target.flex else (cls(*there.board.half),)

    def alternatives(self) -> tuple[Self, ...]:
        return tuple(replace(self, size=size) for size in SIZES)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return ()

    def apply(self, path: Path) -> Path:
        return replace(
            path,
            target=replace(path.target, flex=(self.half_x, self.half_y)),
            block_scales=(*path.block_scales, (FLEX, self.size)),
        )

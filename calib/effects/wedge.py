"""The outer surface is turned against the inner one, so the glass is thicker on one side."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.cover_tilt import axis_names, turning_axes
from calib.effects.effect import Effect, Surroundings, Unknown
from calib.optics.params import Param
from calib.optics.path import Path

SIGMA = 0.01
"""rad"""


@dataclass(frozen=True, slots=True)
class Wedge(Effect):
    """The outer surface is turned about the origin of the cover's frame."""

    axes: str
    name: ClassVar[str] = "wedge"

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        axes = turning_axes(there.path)
        return (cls(axes),) if axes else ()

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return tuple(Unknown(Param(f"wedge.{axis}", "rad", 1e-2), SIGMA) for axis in self.axes)

    def apply(self, path: Path) -> Path:
        *before, outer = path.cover
        frame = replace(outer.frame, more=(*outer.frame.more, axis_names("wedge", self.axes)))
        return replace(path, cover=(*before, replace(outer, frame=frame)))

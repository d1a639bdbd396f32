"""There is a window in front of the camera that nobody declared, and perhaps water behind it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import torch
from torch import Tensor

from calib.effects.effect import Effect, Surroundings, Unknown
from calib.optics.flat import Flat
from calib.optics.frame import Frame
from calib.optics.interface import Interface
from calib.optics.params import Param, Values
from calib.optics.path import Path

WALL_INDEX = 1.49
"""Acrylic; a window's own index hardly matters beside what is behind it."""
WALL = 6e-3
"""m"""
DISTANCE = 0.025
"""m"""
INDEX_SIGMA = 1e-3
"""Of what is behind it: fresh water from cold to warm, over the spectrum of a camera."""
BEHIND = {"air": 1.0, "water": 1.333}


@dataclass(frozen=True, slots=True)
class FlatPort(Effect):
    """A flat window across the optical axis. Neutral: nothing but air behind a window without thickness."""

    behind: str
    """air or water"""
    name: ClassVar[str] = "flat_port"
    judged_by_score: ClassVar[bool] = False

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return () if there.path.cover else tuple(cls(behind) for behind in BEHIND)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return (
            Unknown(Param("flat_port.distance", "m", 1e-3), 0.02, DISTANCE, DISTANCE),
            Unknown(Param("flat_port.tilt.x", "rad", 1e-2), 0.1),
            Unknown(Param("flat_port.tilt.y", "rad", 1e-2), 0.1),
            Unknown(Param("flat_port.thickness", "m", 1e-3), 2e-3, 0.0, WALL),
            Unknown(Param("flat_port.outside_index", "", 1e-2), INDEX_SIGMA, 1.0, BEHIND[self.behind]),
        )

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(unknown.param for unknown in self.unknowns if unknown.param.name != "flat_port.distance")

    def apply(self, path: Path) -> Path:
        frame = Frame(origin=(None, None, "flat_port.distance"), tilt=("flat_port.tilt.x", "flat_port.tilt.y", None))
        window = (Interface("inner", Flat(), frame), Interface("outer", Flat(), frame))
        return replace(path, cover=window, adjustments=(*path.adjustments, self))

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        """The window's numbers as the cover's."""
        index = torch.full_like(values["flat_port.thickness"], WALL_INDEX)
        told = {"cover.thickness": values["flat_port.thickness"], "cover.outside_index": values["flat_port.outside_index"]}
        return pixels, {**values, "cover.refractive_index": index, **told}

"""There is a window in front of the camera that nobody declared, and perhaps water behind it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import torch
from torch import Tensor

from calib.effects.effect import Effect, Surroundings, Unknown
from calib.optics.cover_frame import Frame
from calib.optics.flat import Flat
from calib.optics.interface import Interface
from calib.optics.params import Param, Values
from calib.optics.path import Path

WALL_INDEX = 1.49
"""Acrylic; a window's own index hardly matters beside what is behind it."""
WALL = 6e-3
"""m"""
DISTANCE = 0.025
"""m"""
WALL_SIGMA = 5e-3
"""m: from a filter's glass to an aquarium's."""
AIR, WATER = 1.0, (1.333, 1e-3)
"""Index; of water with its sigma: fresh water from cold to warm, over the spectrum of a camera."""


@dataclass(frozen=True, slots=True)
class FlatPort(Effect):
    """A flat window across the optical axis. Neutral: nothing but air behind a window without thickness."""

    behind: str
    """air or water"""
    name: ClassVar[str] = "flat_port"
    judged_by_score: ClassVar[bool] = False

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return () if there.path.cover else (cls("air"), cls("water"))

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        tilt = (Unknown(Param(f"flat_port.tilt.{axis}", "rad", 1e-2), 0.1) for axis in "xy")
        slab = (*tilt, Unknown(Param("flat_port.thickness", "m", 1e-3), WALL_SIGMA, 0.0, WALL))
        if self.behind == "air":  # where it stands moves no ray
            return slab
        index, sigma = WATER
        return (
            Unknown(Param("flat_port.distance", "m", 1e-3), 0.02, DISTANCE, DISTANCE),
            *slab,
            Unknown(Param("flat_port.outside_index", "", 1e-2), sigma, AIR, index),
        )

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(unknown.param for unknown in self.unknowns if unknown.param.name != "flat_port.distance")

    def apply(self, path: Path) -> Path:
        distance = None if self.behind == "air" else "flat_port.distance"
        frame = Frame(origin=(None, None, distance), tilt=("flat_port.tilt.x", "flat_port.tilt.y", None))
        window = (Interface("inner", Flat(), frame), Interface("outer", Flat(), frame))
        return replace(path, cover=window, adjustments=(*path.adjustments, self))

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        """The window's numbers as the cover's."""
        thickness = values["flat_port.thickness"]
        wall, air = (torch.full_like(thickness, index) for index in (WALL_INDEX, AIR))
        outside = values.get("flat_port.outside_index", air)
        return pixels, {**values, "cover.refractive_index": wall, "cover.thickness": thickness, "cover.outside_index": outside}

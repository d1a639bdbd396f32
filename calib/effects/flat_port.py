"""There is a window in front of the camera that nobody declared, and perhaps water behind it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import torch
from torch import Tensor

from calib.effects.effect import Effect, Surroundings, Unknown
from calib.optics.cover_frame import CoverFrame
from calib.optics.flat import Flat
from calib.optics.interface import Interface
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.tolerances import PORT_DISTANCE, PORT_THICKNESS, PORT_TILT, WATER_INDEX

WALL_INDEX = 1.49
"""Acrylic; a window's own index hardly matters beside what is behind it."""
WALL = 6e-3
"""m"""
DISTANCE = 0.025
"""m"""
AIR, WATER = 1.0, 1.333
UNSAID = 0.1
"""How often a window stands there of which the session says nothing, over causes that no session
speaks of.
"""


@dataclass(frozen=True, slots=True)
class FlatPort(Effect):
    """A flat window across the optical axis.

    Neutral: nothing but air behind a window without thickness.
    """

    behind: str
    """air or water"""
    name: ClassVar[str] = "flat_port"
    about: ClassVar[str] = "what stands before the lens"
    advice: ClassVar[str] = (
        "hold the board near and far: what a window does depends on depth, what a lens does not"
    )
    judged_by_score: ClassVar[bool] = False
    beforehand: ClassVar[float] = UNSAID

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return () if there.path.cover else (cls("air"), cls("water"))

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        tilt = (Unknown.of(f"flat_port.tilt.{axis}", PORT_TILT) for axis in "xy")
        slab = (
            *tilt,
            Unknown(Param("flat_port.thickness", "m", 1e-3), PORT_THICKNESS.sigma, 0.0, WALL),
        )
        if self.behind == "air":  # where it stands moves no ray
            return slab
        return (
            Unknown(
                Param("flat_port.distance", "m", 1e-3), PORT_DISTANCE.sigma, DISTANCE, DISTANCE
            ),
            *slab,
            Unknown(Param("flat_port.outside_index", "", 1e-2), WATER_INDEX.sigma, AIR, WATER),
        )

    @property
    def form(self) -> str:
        return self.behind

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(
            unknown.param for unknown in self.unknowns if unknown.param.name != "flat_port.distance"
        )

    def displaced(self, values: Values) -> tuple[Values, ...]:
        """Behind a window in water a camera looks as if its focal length were longer, by water's
        index, or, if its lens has no distortion that could take up the window's, shorter.
        """
        factors = WATER ** (torch.arange(-4, 3) / 4) if self.behind == "water" else ()
        return tuple(
            {name: values[name] * factor for name in ("camera.fx", "camera.fy")}
            for factor in factors
        )

    def apply(self, path: Path) -> Path:
        distance = None if self.behind == "air" else "flat_port.distance"
        frame = CoverFrame(
            origin=(None, None, distance), tilt=("flat_port.tilt.x", "flat_port.tilt.y", None)
        )
        window = (Interface("inner", Flat(), frame), Interface("outer", Flat(), frame))
        return replace(path, cover=window, adjustments=(*path.adjustments, self))

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        """The window's parameters as the cover's."""
        thickness = values["flat_port.thickness"]
        wall, air = (torch.full_like(thickness, index) for index in (WALL_INDEX, AIR))
        outside = values.get("flat_port.outside_index", air)
        return pixels, {
            **values,
            "cover.refractive_index": wall,
            "cover.thickness": thickness,
            "cover.outside_index": outside,
        }

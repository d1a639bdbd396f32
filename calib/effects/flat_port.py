"""There is a window in front of the camera that nobody declared, and perhaps water behind it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import torch
from torch import Tensor

from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.cover_frame import CoverFrame
from calib.optics.exposure import Exposure
from calib.optics.flat import Flat
from calib.optics.interface import SmoothCover, interfaces_of
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.parameter_names import CAMERA, COVER
from calib.session.tolerances import PORT_DISTANCE, PORT_THICKNESS, PORT_TILT, WATER_INDEX

WALL_INDEX = 1.49
"""The index of acrylic. The window's index matters little compared with the medium behind it."""
WALL_THICKNESS = 6e-3
"""m"""
DISTANCE = 0.025
"""m"""
AIR, WATER = 1.0, 1.333
PRIOR_ODDS = 0.1
"""The odds of a window that the session does not declare, against causes that no session declares.
"""


@dataclass(frozen=True, slots=True)
class FlatPort(Effect):
    """A flat window perpendicular to the optical axis, but for a tilt.

    Its neutral values are a window without thickness and air behind it.
    """

    behind: str
    """The medium behind the window: air or water."""
    name: ClassVar[str] = "flat_port"
    description: ClassVar[str] = "There is a window in front of the camera that nobody declared."
    about: ClassVar[str] = "the space in front of the lens"
    advice: ClassVar[str] = (
        "hold the board near and far: what a window does depends on depth, what a lens does not"
    )
    judged_by_score: ClassVar[bool] = False
    prior_odds: ClassVar[float] = PRIOR_ODDS

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        return () if context.path.cover else (cls("air"), cls("water"))

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        tilt = (EffectParameter.of(f"flat_port.tilt.{axis}", PORT_TILT) for axis in "xy")
        slab = (
            *tilt,
            EffectParameter(
                Param("flat_port.thickness", "m", 1e-3), PORT_THICKNESS.sigma, 0.0, WALL_THICKNESS
            ),
        )
        if self.behind == "air":  # its distance moves no ray
            return slab
        return (
            EffectParameter(
                Param("flat_port.distance", "m", 1e-3), PORT_DISTANCE.sigma, DISTANCE, DISTANCE
            ),
            *slab,
            EffectParameter(
                Param("flat_port.outside_index", "", 1e-2), WATER_INDEX.sigma, AIR, WATER
            ),
        )

    @property
    def form(self) -> str:
        return self.behind

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(
            parameter.param
            for parameter in self.effect_parameters
            if parameter.param.name != "flat_port.distance"
        )

    def alternative_starts(self, values: Values) -> tuple[Values, ...]:
        """Return scaled focal lengths. A camera behind a window in water looks as if its focal
        length were longer by water's index or, if its lens has no distortion that could compensate
        for the window's, shorter.
        """
        factors = WATER ** (torch.arange(-4, 3) / 4) if self.behind == "water" else ()
        return tuple({name: values[name] * factor for name in CAMERA.focal} for factor in factors)

    def apply(self, path: Path) -> Path:
        distance = None if self.behind == "air" else "flat_port.distance"
        frame = CoverFrame(
            origin=(None, None, distance), tilt=("flat_port.tilt.x", "flat_port.tilt.y", None)
        )
        window = interfaces_of(SmoothCover(Flat(), frame))
        return replace(path, cover=window, adjustments=(*path.adjustments, self))

    def __call__(
        self, pixels: Tensor, values: Values, _exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]:
        """Return the values with the window's parameters as those of the cover."""
        thickness = values["flat_port.thickness"]
        wall = torch.full_like(thickness, WALL_INDEX)
        air = torch.full_like(thickness, AIR)
        outside_index = values.get("flat_port.outside_index", air)
        return pixels, {
            **values,
            COVER.refractive_index(): wall,
            COVER.thickness(): thickness,
            COVER.outside_index: outside_index,
        }

"""Limits that a manifest sets to a camera's numbers, and the names of these numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from calib.errors import InputError, brief
from calib.session.camera import PINHOLE
from calib.session.cover import SHAPES
from calib.session.lens import NAMES

QUALITY = ("error_px", "held_out_px", "noise_px", "sigma_px", "relief_um")
"""How good a fit is, and how uneven its glass: each above 0, and better where it is less."""
EFFECTIVE = ("effective_fx", "effective_fy")
"""px, the focal length of the rays beyond the cover, across the middle half of the picture. What a
fit shares out among lens, cover and relief is told apart only as well as its views tell them; these
are what all of them make together.
"""
NUMBERED = tuple(
    dict.fromkeys(
        (
            *QUALITY,
            *EFFECTIVE,
            *(f"camera.{quantity.key}" for quantity in PINHOLE),
            *(f"camera.{name}" for names in NAMES.values() for name in names),
            *(
                f"cover.{name}"
                for quantities in SHAPES.values()
                for quantity in quantities
                for name in quantity.names
            ),
        )
    )
)
"""Every number that a fleet may chart and limit, by the names and in the units that a fit prints.
"""
ENDS = ("min", "max")


@dataclass(frozen=True, slots=True)
class Limit:
    """The smallest and the largest that a number may be."""

    name: str
    low: float = -math.inf
    high: float = math.inf

    def broken(self, value: float) -> bool:
        return not self.low <= value <= self.high

    def __str__(self) -> str:
        if math.isinf(self.low):
            return f"at most {self.high:g}"
        return (
            f"at least {self.low:g}" if math.isinf(self.high) else f"{self.low:g} to {self.high:g}"
        )


def limit_of(name: str, ends: Mapping[str, float], where: str) -> Limit:
    """Args: ends: of min and max, one or both; where: it stands, for messages."""
    if name not in NUMBERED:
        near = get_close_matches(brief(name), NUMBERED, 1)
        hint = f"did you mean {near[0]}" if near else f"write one such as {', '.join(NUMBERED[:6])}"
        raise InputError(f"{where}: {brief(name)!r} is not a number of a camera: {hint}.")
    limit = Limit(name, ends.get("min", -math.inf), ends.get("max", math.inf))
    if limit.low > limit.high:
        raise InputError(
            f"{where}: {name} has {limit.low:g} as its min and {limit.high:g} as its max: exchange"
            " them."
        )
    return limit

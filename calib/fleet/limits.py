"""Limits that a manifest sets to a camera's numbers, and the names of these numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from calib.errors import InputError, brief, meant
from calib.session.camera import PINHOLE
from calib.session.lens import NAMES
from calib.session.parameter_names import CAMERA, COVER, number_of
from calib.session.shapes.registry import dimensions

QUALITY = ("error_px", "held_out_px", "noise_px", "sigma_px", "relief_um")
"""The quality of a fit and the unevenness of its glass: each is above 0, and less is better."""
EFFECTIVE = ("effective_fx", "effective_fy")
"""px, the focal length of the rays beyond the cover, over the middle half of the picture. The views
often cannot separate lens, cover and relief; these numbers describe all of them together.
"""
ENDS = ("min", "max")


@dataclass(frozen=True, slots=True)
class Limit:
    """The range in which a number must lie."""

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


def number_names() -> tuple[str, ...]:
    """Return all numbers that a fleet may chart and limit, by the names and in the units that a fit
    prints.
    """
    names = (
        *QUALITY,
        *EFFECTIVE,
        *(CAMERA.of(quantity.key) for quantity in PINHOLE),
        *(CAMERA.of(name) for names in NAMES.values() for name in names),
        *(COVER.of(name) for dimension in dimensions() for name in dimension.quantity.names),
    )
    return tuple(dict.fromkeys(names))


def limit_of(name: str, ends: Mapping[str, float], where: str) -> Limit:
    """Return the limit of a number.

    Args:
        ends: min, max, or both.
        where: the place in the manifest, for messages.

    Raises:
        InputError: no number has this name, or min is above max.
    """
    names = number_names()
    if name not in names and COVER.of(number_of(name)) not in names:
        near = meant(name, names)
        hint = f"did you mean {near}" if near else f"write one such as {', '.join(names[:6])}"
        raise InputError(f"{where}: {brief(name)!r} is not a number of a camera: {hint}.")
    limit = Limit(name, ends.get("min", -math.inf), ends.get("max", math.inf))
    if limit.low > limit.high:
        raise InputError(
            f"{where}: {name} has {limit.low:g} as its min and {limit.high:g} as its max: exchange"
            " them."
        )
    return limit

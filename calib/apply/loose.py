"""What a calibration leaves open in another medium: which numbers, and how well they would have to
be measured.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.apply.map_uncertainty import root_of
from calib.calibration import Calibration

Array = NDArray[np.float64]

OUTSIDE = "outside_index"
UNKNOWN = 0.15
"""px, predicted standard deviation of the maps: above it there is a warning.

Calibrations in the medium itself reach a few hundredths.
"""
WORTH_NAMING = 0.8
"""A number is named as loose if sigma without its error would be less than this fraction."""
WORDS = {
    "relief": "the glass's unevenness",
    "camera": "the camera's focal length, principal point and lens",
    "distance": "how far the glass is from the pinhole (distance_mm)",
    "centre": "where the dome's centre is (centre_mm)",
    "axis_offset": "where the cover's axis is (axis_offset_mm)",
    "inner_radius": "the cover's inner radius",
    "radius_slope": "the cover's slope",
    "tilt": "the cover's tilt",
    "thickness": "the glass's thickness",
    "refractive_index": "the glass's refractive index",
    OUTSIDE: "the index of what is outside",
}
ADVICE = {
    "camera": "calibrate the camera without its cover, in bare/",
    "relief": "no view in one medium tells it well",
    OUTSIDE: "measure its salinity and temperature, and write --index-sigma",
}
SHOWN = {"m": ("mm", 1e3), "rad": ("degrees", 180 / np.pi), "": ("", 1.0)}
"""Units as session.yaml has them."""


@dataclass(frozen=True, slots=True)
class Loose:
    """A group of numbers, and how sure the maps would be if they were known exactly."""

    name: str
    """A key of WORDS, or an effect's name."""
    sigma_px: tuple[float, ...]
    """By depth."""
    measured_to: float | None = None
    """The standard deviation, in `unit`, with which no depth's sigma is above UNKNOWN; None: there
    is none, or nobody can measure it.
    """
    unit: str = ""

    @property
    def words(self) -> str:
        return WORDS.get(self.name, f"the effect {self.name}")

    @property
    def advice(self) -> str:
        if advice := ADVICE.get(self.name):
            return advice
        to = (
            ""
            if self.measured_to is None
            else f" to {self.measured_to:.2g} {self.unit}".rstrip() + " (one sigma) or better"
        )
        return f"measure it{to}, state it with its sigma in session.yaml, and fit again"


def loose_numbers(wet: Calibration, errors: Array, depths: Sequence[float]) -> list[Loose]:
    """The groups that are worth naming, the one that matters most first.

    Args:
        wet: in its new medium.
        errors: (N, 4, S) of A and B of some pixels, by the parameters.
        depths: m.
    """
    if not wet.covariance.size:
        return []
    sigma = np.array(sigmas(errors, wet.covariance, depths))
    every = (_loose(wet, group, names, errors, depths) for group, names in _groups(wet))
    return sorted(
        (one for one in every if (np.array(one.sigma_px) < WORTH_NAMING * sigma).any()),
        key=lambda one: one.sigma_px,
    )


def sigmas(errors: Array, covariance: Array, depths: Sequence[float]) -> tuple[float, ...]:
    """px by depth, root mean square over the pixels."""
    return _spreads(errors, root_of(covariance), depths) if covariance.size else ()


def _spreads(errors: Array, root: Array, depths: Sequence[float]) -> tuple[float, ...]:
    spread = errors @ root
    offs = (spread[:, :2] + spread[:, 2:] / depth for depth in depths)
    return tuple(float(np.sqrt(np.nanmean((off**2).sum((1, 2))))) for off in offs)


def _groups(wet: Calibration) -> Iterator[tuple[str, list[str]]]:
    """The parameters that belong together."""
    groups: dict[str, list[str]] = {}
    for name in wet.camera_model().parameters.slices():
        head, _, rest = name.partition(".")
        groups.setdefault(rest.split(".")[0] if head == "cover" else head, []).append(name)
    yield from groups.items()


def _loose(
    wet: Calibration, group: str, names: Sequence[str], errors: Array, depths: Sequence[float]
) -> Loose:
    parameters, covariance = wet.camera_model().parameters, wet.covariance
    at = parameters.entries(names)
    along = covariance[:, at] @ np.linalg.pinv(
        covariance[np.ix_(at, at)], hermitian=True
    )  # (S, n) how all move with these
    known = np.array(sigmas(errors, covariance - along @ covariance[at], depths))
    own = [param for param in parameters.free if param.name in names]
    if (
        group in ADVICE
        or group not in WORDS
        or len({(param.unit, param.scale) for param in own}) != 1
        or (known >= UNKNOWN).any()
    ):
        return Loose(group, tuple(known))
    unit, per_si = SHOWN[own[0].unit]
    each = np.maximum(
        _spreads(errors, along, depths), np.finfo(float).tiny
    )  # px, of numbers that are known to one of their scale
    return Loose(
        group,
        tuple(known),
        float(np.min(np.sqrt(UNKNOWN**2 - known**2) / each)) * own[0].scale * per_si,
        unit,
    )

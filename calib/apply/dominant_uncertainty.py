"""The parameters that dominate a calibration's uncertainty in another medium, and the standard
deviation to which each would have to be measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.estimation.covariance import covariance_root, regression
from calib.session.cover import MEDIUM

Array = NDArray[np.float64]

MAX_SIGMA_PX = 0.15
"""px: a predicted standard deviation of the maps above this gets a warning.

Calibrations that are made in the medium itself reach a few hundredths.
"""
DOMINANCE_FRACTION = 0.8
"""A group dominates if sigma without its errors is less than this fraction of the full sigma."""
WORDS = {
    "relief": "the uneven glass",
    "camera": "the camera's focal length, principal point and lens",
}
"""The words for groups that are no dimension of the cover."""
ADVICE = {
    "camera": "calibrate the camera without its cover, in bare/",
    "relief": "",
    MEDIUM: "measure its salinity and temperature, and write --index-sigma",
}
"""The advice for groups that are not measured with a rule; none for what no view in one medium
determines well.
"""
DISPLAY_UNITS = {"m": ("mm", 1e3), "rad": ("degrees", 180 / np.pi), "": ("", 1.0)}
"""The unit in session.yaml for each SI unit, and the number of these in one SI unit."""


@dataclass(frozen=True, slots=True)
class DominantUncertainty:
    """A group of parameters, and the sigma of the maps if these parameters had no error."""

    name: str
    """A key of WORDS, the stem of a dimension's key, or an effect's name."""
    words: str
    """The group in words."""
    sigma_px: tuple[float, ...]
    """The sigma of the maps without the errors of this group, for each depth."""
    measured_to: float | None = None
    """The standard deviation, in `unit`, at which the sigma of no depth exceeds MAX_SIGMA_PX. None
    if no standard deviation suffices, or nobody can measure these parameters.
    """
    unit: str = ""

    @property
    def advice(self) -> str:
        """The words on what to measure; empty if nothing can be measured."""
        if self.name in ADVICE:
            return ADVICE[self.name]
        to = (
            ""
            if self.measured_to is None
            else f" to {self.measured_to:.2g} {self.unit}".rstrip() + " (one sigma) or better"
        )
        return f"measure it{to}, state it with its sigma in session.yaml, and fit again"


def find_dominant_uncertainties(
    wet: Calibration, errors: Array, depths: Sequence[float]
) -> list[DominantUncertainty]:
    """Return the groups that dominate sigma, the one with the largest influence first.

    Args:
        wet: the calibration in its new medium.
        errors: (N, 4, S) derivatives of A and B of N pixels by the parameters.
        depths: m
    """
    if not wet.covariance.size:
        return []
    sigma = np.array(sigmas(errors, wet.covariance, depths))
    groups = (
        _without_group(wet, group, names, errors, depths)
        for group, names in _parameter_groups(wet).items()
    )
    return sorted(
        (
            group
            for group in groups
            if (np.array(group.sigma_px) < DOMINANCE_FRACTION * sigma).any()
        ),
        key=lambda group: group.sigma_px,
    )


def sigmas(errors: Array, covariance: Array, depths: Sequence[float]) -> tuple[float, ...]:
    """Return the sigma of the maps for each depth: px, root mean square over the pixels; nothing
    without a covariance.
    """
    return _map_sigmas(errors, covariance_root(covariance), depths) if covariance.size else ()


def _map_sigmas(errors: Array, root: Array, depths: Sequence[float]) -> tuple[float, ...]:
    """Return the same for parameters whose covariance has the (S, K) root."""
    spread = errors @ root
    displacements = (spread[:, :2] + spread[:, 2:] / depth for depth in depths)
    return tuple(float(np.sqrt(np.nanmean((px**2).sum((1, 2))))) for px in displacements)


def _parameter_groups(wet: Calibration) -> dict[str, list[str]]:
    """Return the names of each group's parameters by the group's name."""
    dimensions = wet.cover.dimensions
    groups: dict[str, list[str]] = {}
    for name in wet.camera_model().parameters.slices():
        dimension = dimensions.get(name)
        group = dimension.quantity.stem if dimension else name.partition(".")[0]
        groups.setdefault(group, []).append(name)
    return groups


def _without_group(
    wet: Calibration, group: str, names: Sequence[str], errors: Array, depths: Sequence[float]
) -> DominantUncertainty:
    """Return the sigma of the maps if the parameters of one group had no error."""
    parameters, covariance = wet.camera_model().parameters, wet.covariance
    at = parameters.entries(names)
    by_group = regression(covariance, at)
    sigma = np.array(sigmas(errors, covariance - by_group @ covariance[at], depths))
    params = [param for param in parameters.free if param.name in names]
    dimension = wet.cover.dimensions.get(names[0])
    words = dimension.words if dimension else WORDS.get(group, f"the effect {group}")
    if (
        group in ADVICE
        or not dimension
        or len({(param.unit, param.scale) for param in params}) != 1
        or (sigma >= MAX_SIGMA_PX).any()
    ):
        return DominantUncertainty(group, words, tuple(sigma))
    unit, per_si = DISPLAY_UNITS[params[0].unit]
    # px for each depth, if sigma of these parameters were one of their scale
    unit_sigma = np.maximum(_map_sigmas(errors, by_group, depths), np.finfo(float).tiny)
    return DominantUncertainty(
        group,
        words,
        tuple(sigma),
        float(np.min(np.sqrt(MAX_SIGMA_PX**2 - sigma**2) / unit_sigma)) * params[0].scale * per_si,
        unit,
    )

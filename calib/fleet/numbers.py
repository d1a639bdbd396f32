"""The numbers of one camera that its fleet is charted by, and how far they are from its prior's."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from calib.calibration import Calibration
from calib.estimation.relief_heights import height_spread
from calib.fitting.declared import comparisons
from calib.fleet.limits import EFFECTIVE
from calib.verdict.sureness import map_sigmas

USUAL_DEPTH = 1.0
"""m, where maps are compared if none are asked for."""


@dataclass(frozen=True, slots=True)
class Measured:
    """A number with its standard deviation: 0 where it has none, as an error."""

    value: float
    sigma: float
    unit: str


@dataclass(frozen=True, slots=True)
class Moved:
    """A number of the camera against its prior's."""

    before: float
    after: float
    sigmas: float
    """Their difference over the standard deviation that both give it."""
    unit: str


def numbers(first: Calibration, last: Calibration, depth: float) -> dict[str, Measured]:
    """By the names of calib.fleet.limits; what the fit does not have, or held as it is declared, is
    left out.

    Args:
        first: as fitted. Its errors are compared: an effect that was added would hide what it was
            added for.
        last: with the effects that were found.
        depth: m, of the maps whose standard deviation is told.
    """
    validation = first.settings.get("cross_validation", {})
    quality = {
        "error_px": first.stages[-1].rms_px,
        "held_out_px": validation.get("held_out_px", math.nan),
        "noise_px": first.noise_px,
        "sigma_px": map_sigmas(first, (depth,)).get(depth, math.nan),
        "relief_um": (
            1e6 * height_spread(*first.model(), first.observations) if first.relief else math.nan
        ),
    }
    sigma = {
        "held_out_px": validation.get("held_out_sigma_px", 0.0)
    }  # a few views that the others hardly predict make most of it
    found = {
        name: Measured(value, sigma.get(name, 0.0), name.rpartition("_")[2].replace("um", "µm"))
        for name, value in quality.items()
    }
    found |= {
        name: Measured(value, 0.0, "px")
        for name, value in zip(EFFECTIVE, effective_focal(last), strict=True)
    }
    found |= {
        one.name: Measured(one.estimate, one.sigma, one.unit)
        for one in comparisons(last)
        if one.sigma > 0
    }
    return {name: one for name, one in found.items() if math.isfinite(one.value)}


def effective_focal(calibration: Calibration) -> tuple[float, float]:
    """px, across and down: of the pinhole that would see the middle half of the picture under the
    angle that its outermost rays enclose.
    """
    size = np.array([calibration.camera.width, calibration.camera.height])
    half = np.diag(size) / 4
    _, seen = calibration.rays(size / 2 - 0.5 + np.concatenate([-half, half]))
    apart, together = (
        np.linalg.norm(both, axis=1) for both in (seen[:2] - seen[2:], seen[:2] + seen[2:])
    )
    across, down = size / 4 * together / apart  # over the tangent of half of each angle
    return float(across), float(down)


def moved(prior: Calibration, now: Calibration) -> dict[str, Moved]:
    """Every number that both have and one of them estimated.

    Both may have started from the same declared value, so that they differ by less than their
    standard deviations say: what is far apart here has moved.
    """
    before = {one.name: one for one in comparisons(prior)}
    changed = {}
    for one in comparisons(now):
        other = before.get(one.name)
        if other and other.unit == one.unit and (spread := math.hypot(one.sigma, other.sigma)) > 0:
            changed[one.name] = Moved(
                other.estimate, one.estimate, (one.estimate - other.estimate) / spread, one.unit
            )
    return changed


def as_json(found: Mapping[str, Measured | Moved]) -> dict[str, object]:
    return {name: asdict(one) for name, one in found.items()}

"""The numbers of a camera that the fleet charts, and their differences from the prior's."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from calib.apply.map_uncertainty import map_sigmas
from calib.calibration import Calibration
from calib.estimation.relief_heights import height_spread
from calib.fitting.declared import comparisons
from calib.fleet.limits import EFFECTIVE
from calib.session.deviation import independent_deviation

USUAL_DEPTH = 1.0
"""m, at which maps are compared if the command states no depth."""


@dataclass(frozen=True, slots=True)
class FleetNumber:
    """A number with its standard deviation, which is 0 for an error without one."""

    value: float
    sigma: float
    unit: str


@dataclass(frozen=True, slots=True)
class PriorShift:
    """A number of the camera compared with the prior's."""

    prior: float
    current: float
    sigmas: float
    """The difference over its standard deviation, from both calibrations."""
    unit: str


def fleet_numbers(first: Calibration, last: Calibration, depth: float) -> dict[str, FleetNumber]:
    """Return the numbers that the fit estimated, by the names of calib.fleet.limits.

    Args:
        first: the fit without effects. Fleets compare its errors: an effect that was added would
            hide the error that it was added for.
        last: the calibration with the effects of the diagnosis.
        depth: m, of the maps whose standard deviation is among the numbers.
    """
    numbers = {"error_px": FleetNumber(first.stages[-1].rms_px, 0.0, "px")}
    if first.noise_px is not None:
        numbers["noise_px"] = FleetNumber(first.noise_px, 0.0, "px")
    if validation := first.outcome.cross_validation:
        # A few views that the others predict badly make most of the held-out error.
        numbers["held_out_px"] = FleetNumber(
            validation.held_out_px, validation.held_out_sigma_px, "px"
        )
    for sigma_px in map_sigmas(first, (depth,)).values():
        numbers["sigma_px"] = FleetNumber(sigma_px, 0.0, "px")
    if first.relief:
        spread_um = 1e6 * height_spread(*first.model(), first.observations)
        numbers["relief_um"] = FleetNumber(spread_um, 0.0, "µm")
    numbers |= {
        name: FleetNumber(value, 0.0, "px")
        for name, value in zip(EFFECTIVE, effective_focal(last), strict=True)
    }
    numbers |= {
        number.name: FleetNumber(number.estimate, number.sigma, number.unit)
        for number in comparisons(last)
        if number.sigma > 0
    }
    return {name: number for name, number in numbers.items() if math.isfinite(number.value)}


def effective_focal(calibration: Calibration) -> tuple[float, float]:
    """Return the effective focal lengths in x and y, in px.

    They are those of a pinhole camera whose middle half of the picture spans the same angle as the
    rays of this camera do.
    """
    size = np.array([calibration.camera.width, calibration.camera.height])
    half = np.diag(size) / 4
    _, directions = calibration.rays(size / 2 - 0.5 + np.concatenate([-half, half]))
    differences = np.linalg.norm(directions[:2] - directions[2:], axis=1)
    sums = np.linalg.norm(directions[:2] + directions[2:], axis=1)
    focal = size / 4 * sums / differences  # over the tangent of half of each angle
    return float(focal[0]), float(focal[1])


def prior_shifts(prior: Calibration, current: Calibration) -> dict[str, PriorShift]:
    """Return the shift of every number that both calibrations have and at least one estimated.

    Both may have started from the same declared value. Then they differ by less than their standard
    deviations say, so a large difference is a real change.
    """
    previous = {number.name: number for number in comparisons(prior)}
    shifts: dict[str, PriorShift] = {}
    for number in comparisons(current):
        earlier = previous.get(number.name)
        if not earlier or earlier.unit != number.unit:
            continue
        if number.sigma > 0 or earlier.sigma > 0:
            shift = number.estimate - earlier.estimate
            shifts[number.name] = PriorShift(
                prior=earlier.estimate,
                current=number.estimate,
                sigmas=independent_deviation(shift, number.sigma, earlier.sigma),
                unit=number.unit,
            )
    return shifts


def numbers_as_json(numbers: Mapping[str, FleetNumber]) -> dict[str, object]:
    """Return the numbers as a camera's JSON has them."""
    return {name: asdict(number) for name, number in numbers.items()}


def shifts_as_json(shifts: Mapping[str, PriorShift]) -> dict[str, object]:
    """Return the shifts as a camera's JSON has them."""
    return {
        name: {
            "before": shift.prior,
            "after": shift.current,
            "sigmas": shift.sigmas,
            "unit": shift.unit,
        }
        for name, shift in shifts.items()
    }

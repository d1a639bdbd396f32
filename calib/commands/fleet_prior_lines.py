"""A fleet's prior on the terminal: the sigma of each number before any view, and the cameras that
were left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

from calib.errors import harmless
from calib.rounding import with_sigma
from calib.session.camera import COEFFICIENT, PINHOLE
from calib.session.fleet_prior import FleetPrior
from calib.session.numbers import numbers_of
from calib.session.parameter_names import CAMERA

UNITS = {"millimetres": "mm", "degrees": "deg"}
MAX_CAMERAS = 40
"""Cameras that are listed."""


def print_prior(prior: FleetPrior, written: Path) -> None:
    console = Console(highlight=False)
    console.print(f"The prior of {prior.cameras} cameras for the next one.", style="bold")
    table = Table("number", "declared ± tolerance", "expected ± sigma", "of the tolerance")
    declared_numbers = numbers_of(*prior.declared)
    expected_numbers = numbers_of(prior.intrinsics, prior.cover)
    for name, unit, per_si in _units(prior):
        declared = declared_numbers[name]
        number = expected_numbers[name]
        tolerance = declared.sigma * per_si
        sigma = number.sigma * per_si
        table.add_row(
            name,
            f"{with_sigma(declared.value * per_si, tolerance)} {unit}".rstrip(),
            f"{with_sigma(number.value * per_si, sigma)} {unit}".rstrip(),
            f"{100 * sigma / tolerance:.0f} %",
        )
    console.print(table)
    for camera, because in prior.left_out[:MAX_CAMERAS]:
        console.print(harmless(f"Left out: {camera}: {because}."), markup=False, soft_wrap=True)
    if len(prior.left_out) > MAX_CAMERAS:
        console.print(f"and {len(prior.left_out) - MAX_CAMERAS} more.")
    console.print(harmless(f"Wrote {written}"), markup=False, soft_wrap=True)
    console.print(
        f"A session of such a camera names it in session.yaml: prior: {written.name}, with its"
        " path.",
        markup=False,
        soft_wrap=True,
    )


def prior_json(prior: FleetPrior, written: Path) -> dict[str, object]:
    """Return the object that --json prints."""
    fleet = numbers_of(prior.intrinsics, prior.cover)
    declared = numbers_of(*prior.declared)
    return {
        "cameras": prior.cameras,
        "left_out": dict(prior.left_out),
        "numbers": {
            name: {
                "unit": unit,
                "value": fleet[name].value * per_si,
                "sigma": fleet[name].sigma * per_si,
                "declared": declared[name].value * per_si,
                "tolerance": declared[name].sigma * per_si,
            }
            for name, unit, per_si in _units(prior)
        },
        "written": [str(written)],
    }


def _units(prior: FleetPrior) -> Iterator[tuple[str, str, float]]:
    """Yield each number of the prior, its unit, and how many units make one SI unit."""
    quantities = {name: kind.quantity for name, kind in prior.cover.dimensions.items()}
    pinhole = {CAMERA.of(quantity.key) for quantity in PINHOLE}
    for name in prior.names:
        unit, per_si = ("px", 1.0) if name in pinhole else quantities.get(name, COEFFICIENT).unit
        yield name, UNITS.get(unit, unit), per_si

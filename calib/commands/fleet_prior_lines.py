"""A fleet's prior on the terminal: how well it knows each number before any view, and whom it was
not made from.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

from calib.errors import harmless
from calib.fitting.rounding import with_sigma
from calib.session.camera import COEFFICIENT, PINHOLE
from calib.session.cover import SHAPES
from calib.session.fleet_prior import FleetPrior
from calib.session.numbers import numbers_of
from calib.session.schema import Quantity

UNITS = {"millimetres": "mm", "degrees": "deg"}
MOST = 40
"""Cameras that are listed."""


def print_prior(prior: FleetPrior, written: Path) -> None:
    console = Console(highlight=False)
    console.print(f"What {prior.cameras} cameras say of the next one.", style="bold")
    table = Table("number", "declared ± tolerance", "expected ± sigma", "of the tolerance")
    for name, unit, per_si in _units(prior):
        (declared, tolerance), (value, sigma) = (
            (number.value * per_si, number.sigma * per_si)
            for number in (
                numbers_of(*prior.declared)[name],
                numbers_of(prior.intrinsics, prior.cover)[name],
            )
        )
        stated, expected = (
            f"{text} {unit}".rstrip()
            for text in (f"{declared:.6g} ± {tolerance:.2g}", with_sigma(value, sigma))
        )
        table.add_row(name, stated, expected, f"{100 * sigma / tolerance:.0f} %")
    console.print(table)
    for camera, because in prior.left_out[:MOST]:
        console.print(harmless(f"Left out: {camera}: {because}."), markup=False, soft_wrap=True)
    if len(prior.left_out) > MOST:
        console.print(f"and {len(prior.left_out) - MOST} more.")
    console.print(harmless(f"Wrote {written}"), markup=False, soft_wrap=True)
    console.print(
        f"A session of such a camera names it in session.yaml: prior: {written.name}, with its"
        " path.",
        markup=False,
        soft_wrap=True,
    )


def prior_json(prior: FleetPrior, written: Path) -> dict[str, object]:
    """The contract's object."""
    fleet, declared = numbers_of(prior.intrinsics, prior.cover), numbers_of(*prior.declared)
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
    """Each number that the prior knows, its unit, and how many of that make one SI unit."""
    quantities: dict[str, Quantity] = {
        f"cover.{name}": quantity
        for quantity in SHAPES[prior.cover.shape]
        for name in quantity.names
    }
    pinhole = {f"camera.{quantity.key}" for quantity in PINHOLE}
    for name in prior.names:
        unit, per_si = ("px", 1.0) if name in pinhole else quantities.get(name, COEFFICIENT).unit
        yield name, UNITS.get(unit, unit), per_si

"""A fleet on the terminal: who stands out, and why."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from calib.errors import harmless
from calib.fleet.findings import Fleet
from calib.fleet.page import headline
from calib.fleet.result import State

MOST = 40
"""Cameras that are listed; the page has all."""


def print_fleet(fleet: Fleet, written: Sequence[Path]) -> None:
    console = Console(markup=False, highlight=False, soft_wrap=True)
    console.print(f"{headline(fleet)}.", style="bold")
    for camera in fleet.outliers[:MOST]:
        first, *rest = fleet.findings[camera]
        more = f" (and {len(rest)} more)" if rest else ""
        console.print(harmless(f"- {camera}: {first.sentence}{more}."))
    if len(fleet.outliers) > MOST:
        console.print(f"- and {len(fleet.outliers) - MOST} more.")
    for path in written:
        console.print(harmless(f"Wrote {path}"))


def fleet_json(fleet: Fleet, written: Sequence[Path]) -> dict[str, object]:
    """The contract's object."""
    return {
        "cameras": len(fleet.entries),
        "states": {
            state.value: sum(result.state is state for result in fleet.results) for state in State
        },
        "stand_out": {
            camera: [finding.sentence for finding in fleet.findings[camera]]
            for camera in fleet.outliers
        },
        "written": [str(path) for path in written],
    }

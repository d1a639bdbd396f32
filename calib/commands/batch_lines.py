"""A fleet on the terminal: the cameras that stand out, and why."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from calib.errors import harmless
from calib.fleet.findings import Fleet
from calib.fleet.page import headline
from calib.fleet.result import JobState

MAX_CAMERAS = 40
"""Cameras that are listed. The page lists all."""


def print_fleet(fleet: Fleet, written: Sequence[Path]) -> None:
    console = Console(markup=False, highlight=False, soft_wrap=True)
    console.print(f"{headline(fleet)}.", style="bold")
    for camera in fleet.outliers[:MAX_CAMERAS]:
        findings = fleet.findings[camera]
        remainder = f" (and {len(findings) - 1} more)" if len(findings) > 1 else ""
        console.print(harmless(f"- {camera}: {findings[0].sentence}{remainder}."))
    if len(fleet.outliers) > MAX_CAMERAS:
        console.print(f"- and {len(fleet.outliers) - MAX_CAMERAS} more.")
    for path in written:
        console.print(harmless(f"Wrote {path}"))


def fleet_json(fleet: Fleet, written: Sequence[Path]) -> dict[str, object]:
    """Return the object that --json prints."""
    return {
        "cameras": len(fleet.entries),
        "states": {
            state.value: sum(result.state is state for result in fleet.results)
            for state in JobState
        },
        "stand_out": {
            camera: [finding.sentence for finding in fleet.findings[camera]]
            for camera in fleet.outliers
        },
        "written": [str(path) for path in written],
    }

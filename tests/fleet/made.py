"""Results of fleets that nobody calibrated, for the page."""

from collections.abc import Mapping

import numpy as np

from calib.fleet.findings import Fleet, judge_fleet
from calib.fleet.manifest import Entry
from calib.fleet.numbers import Measured, Moved
from calib.fleet.result import Result, State

UNITS = {"error_px": "px", "held_out_px": "px", "noise_px": "px", "effective_fx": "px", "camera.fx": "px", "cover.thickness": "mm"}


def result(rng: np.random.Generator, camera: str, *, moved: bool) -> Result:
    errors = {name: Measured(float(0.1 * np.exp(rng.normal(0, 0.05))), 0.0, unit) for name, unit in UNITS.items() if name.endswith("_px")}
    numbers = {name: Measured(float(100 + rng.normal()), 0.3, unit) for name, unit in UNITS.items() if not name.endswith("_px")}
    return Result(
        id=camera,
        state=State.CALIBRATED,
        verdict={"word": "trusted" if rng.random() < 0.7 else "care", "reasons": [], "suspects": [], "next": ""},
        numbers=errors | numbers,
        moved={name: Moved(100.0, 100.1, float(rng.normal()), "px") for name in numbers} if moved else {},
        written=(f"cameras/{camera}/calibration.yaml", f"cameras/{camera}/report.html"),
        views=20,
        seconds=9.0,
    )


def made(count: int, changed: Mapping[str, Result] | None = None, seed: int = 0) -> Fleet:
    """Cameras c0, c1 and on, of two fixtures; some of them replaced."""
    rng = np.random.default_rng([count, seed])
    ids = [f"c{number}" for number in range(count)]
    results = {camera: result(rng, camera, moved=number % 2 == 0) for number, camera in enumerate(ids)} | dict(changed or {})
    entries = [
        Entry(camera, f"/sessions/{camera}", f"SN<{number}>", "", "AB"[number % 2], f"2026-05-{1 + 27 * number // count:02d}")
        for number, camera in enumerate(ids)
    ]
    return judge_fleet(entries, results)

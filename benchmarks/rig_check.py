"""The answers of `calib rig check` about a simulated pair of cameras that is seen again later:
`python -m benchmarks.rig_check [--checks 100]`.

Two cameras 60 mm apart behind flat windows in water are fitted from 20 placements of a board at 0.4
to 1.2 m, 0.1 px of noise, every declared number off by a draw of `fixtures.rigs.DECLARED`. Each
check has 1 to 5 other placements. Unchanged rigs may raise an alarm in 1 % of the checks. The
others have the right camera moved by 1 mm or turned by 0.1 degrees in a random direction, or it
slips by 1 mm in the middle of 4 to 6 placements. Error over sigma is of the size, where the right
name stands alone; the other checks list several causes.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console

from calib.checking.significance import ALPHA
from calib.fit_record.request import Settings
from calib.progress import Silent
from calib.rig.check_result import RigCheckResult
from calib.rig.check_rig import RigChecker
from calib.rig.fit_rig import fit_rig
from calib.rig.later_views import read_later_views, renumber_views
from calib.rig.placements import Placements
from calib.rig.rig import Rig
from calib.rig.rig_file import read_rig
from calib.session.board import Board
from fixtures.rigs import SimulatedRig, join_pictures, simulate_rig, with_motion, with_pictures
from fixtures.synthetic import FLAT_PLACE, WATER, glass

WINDOW = glass("flat", 0.006, outside_index=WATER, **FLAT_PLACE)
SIZES = {"moved": 1e-3, "turned": float(np.radians(0.1))}
"""m and rad"""
PER_SI = {"moved": 1e3, "turned": float(np.degrees(1.0))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--checks", type=int, default=100, help="checks of each kind")
    options = parser.parse_args()
    simulated = simulate_rig(3, WINDOW, placements=20, amplitude=0.0, board=Board(6, 5, 0.03))
    console = Console(soft_wrap=True)
    with tempfile.TemporaryDirectory() as folder:
        rig = fit_rig(simulated.write(Path(folder) / "rig"), Settings(grid=(1, 1), flat_board=True))
        checker = RigChecker.of(rig)
        results = [
            _check(
                rig, checker, with_pictures(np.random.default_rng(seed), simulated, 1 + seed % 5)
            )
            for seed in range(options.checks)
        ]
        alarms = sum(result.p_value < ALPHA for result in results)
        console.print(f"unchanged: {alarms} alarms in {len(results)} checks")
        for kind in SIZES:
            _print_changed(console, rig, checker, simulated, kind, options.checks, slips=False)
        _print_changed(console, rig, checker, simulated, "moved", options.checks, slips=True)


def _print_changed(
    console: Console,
    rig: Rig,
    checker: RigChecker,
    simulated: SimulatedRig,
    kind: str,
    checks: int,
    *,
    slips: bool,
) -> None:
    named, listed, alarms = 0, 0, 0
    normalised = []
    for seed in range(checks):
        rng = np.random.default_rng(10_000 + seed)
        direction = rng.normal(size=3)
        direction *= SIZES[kind] / np.linalg.norm(direction)
        motion = np.zeros(6)
        motion[slice(3, 6) if kind == "moved" else slice(0, 3)] = direction
        changed = with_motion(simulated, "right", motion)
        count = 2 + seed % 2 if slips else 1 + seed % 5
        pictures = with_pictures(rng, changed, count)
        if slips:
            pictures = join_pictures(with_pictures(rng, simulated, 2 + seed % 2), pictures)
        result = _check(rig, checker, pictures)
        alarms += result.p_value < ALPHA
        names = [change.change.name for change in result.changes if bool(change.from_file) == slips]
        if names == [kind]:
            named += 1
            size = result.changes[0].change
            assert size.value is not None
            assert size.sigma
            normalised.append((size.value - PER_SI[kind] * SIZES[kind]) / size.sigma)
        elif kind in names:
            listed += 1
    error = float(np.sqrt(np.mean(np.square(normalised)))) if normalised else float("nan")
    console.print(
        f"{'slipped' if slips else kind}: {alarms} alarms in {checks} checks, {named} named alone,"
        f" {listed} listed with others, error over sigma {error:.2f}"
    )


def _check(rig: Rig, checker: RigChecker, pictures: SimulatedRig) -> RigCheckResult:
    with tempfile.TemporaryDirectory() as folder:
        description = read_rig(pictures.write(Path(folder) / "later"))
        views = {
            name: read_later_views(rig, description, name, Silent())[0]
            for name in description.sessions
        }
    places = Placements.of(description, {name: v.views for name, v in views.items()})
    return checker.check(renumber_views(rig, views, places), places)


if __name__ == "__main__":
    main()

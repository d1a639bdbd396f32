"""The findings of `calib rig diagnose` about simulated pairs of cameras:
`python -m benchmarks.rig_diagnosis [--rigs 20] [--kind late]`.

Two cameras 60 mm apart behind flat windows in water see 30 placements of a board at 0.4 to 1.2 m,
0.1 px of noise, every declared number off by a draw of `fixtures.rigs.DECLARED`. A moving board is
seen in 5 bursts of 6 pictures, 15 a second, at 0.15 m/s; both cameras have the same times. The
kinds:

- late: bursts, and the right camera exposes 8 ms late;
- in time: bursts of cameras that expose together;
- blind: single pictures of a moving board without times, the right camera 8 ms late;
- still: a board that stands still;
- flex: the same, and the mounting of the right camera turns by 0.02 degrees and moves by 0.1 mm,
  standard deviations about and along each axis, from placement to placement;
- slip: the same, and the right camera slips by 0.03 degrees and 0.3 mm after 12 placements;
- sheet: the same, and the board bends anew in each placement, by 0.3 mm (standard deviation of each
  term of degree 2, less for finer ones);
- readout: the board moves while the pictures of both cameras are read out, by 0.17 degrees and 0.5
  mm (standard deviations about and along each axis); readout of one: of the right camera only.

Error over sigma is the root mean square of the sizes' errors over their standard deviations; the
baseline's error is that in mm, before and after.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from calib.fit_record.request import Settings
from calib.rig.diagnose_rig import diagnose_rig
from calib.rig.fit_rig import fit_rig
from calib.rig.rig_finding import RigDiagnosis
from calib.session.board import Board
from fixtures.rig_bends import with_bends
from fixtures.rig_motion import with_bursts, with_flex, with_readout
from fixtures.rigs import SimulatedRig, join_pictures, simulate_rig, with_motion, with_pictures
from fixtures.synthetic import FLAT_PLACE, WATER, glass

WINDOW = glass("flat", 0.006, outside_index=WATER, **FLAT_PLACE)
LATE_S = 8e-3
FLEX_TURN = float(np.radians(0.02))
FLEX_SHIFT = 1e-4
"""m"""
SLIP = np.array([0.0, 0.0, np.radians(0.03), 3e-4, 0.0, 0.0])
BEND = 3e-4
"""m"""
READOUT_TURN = 3e-3
"""rad"""
READOUT_SHIFT = 5e-4
"""m"""
PLACEMENTS = 30

Array = NDArray[np.float64]
Rng = np.random.Generator


def late(rng: Rng, rig: SimulatedRig) -> SimulatedRig:
    return with_bursts(rng, rig, 5, 6, late_s={"right": LATE_S})


def in_time(rng: Rng, rig: SimulatedRig) -> SimulatedRig:
    return with_bursts(rng, rig, 5, 6)


def blind(rng: Rng, rig: SimulatedRig) -> SimulatedRig:
    moved = with_bursts(rng, rig, PLACEMENTS, 1, late_s={"right": LATE_S})
    views = {
        name: tuple(replace(view, time_s=None) for view in camera_views)
        for name, camera_views in moved.views.items()
    }
    return replace(moved, views=views)


def still(rng: Rng, rig: SimulatedRig) -> SimulatedRig:
    return with_pictures(rng, rig, PLACEMENTS)


def flex(rng: Rng, rig: SimulatedRig) -> SimulatedRig:
    return with_flex(rng, still(rng, rig), "right", FLEX_TURN, FLEX_SHIFT)


def slip(rng: Rng, rig: SimulatedRig) -> SimulatedRig:
    later = with_motion(rig, "right", SLIP)
    pictures = with_pictures(rng, rig, 12), with_pictures(rng, later, PLACEMENTS - 12)
    return replace(join_pictures(*pictures), cameras=later.cameras)


def sheet(rng: Rng, rig: SimulatedRig) -> SimulatedRig:
    return with_bends(rng, still(rng, rig), BEND)


def readout(rng: Rng, rig: SimulatedRig) -> SimulatedRig:
    readouts = {"left": 1.0, "right": 1.0}
    return with_readout(rng, still(rng, rig), readouts, READOUT_TURN, READOUT_SHIFT)


def readout_of_one(rng: Rng, rig: SimulatedRig) -> SimulatedRig:
    return with_readout(rng, still(rng, rig), {"right": 1.0}, READOUT_TURN, READOUT_SHIFT)


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of rig, and what a diagnosis should find."""

    make: Callable[[Rng, SimulatedRig], SimulatedRig]
    effect: str = ""
    true: tuple[tuple[str, float], ...] = ()
    """The numbers to find."""


READOUT_NUMBERS = (
    ("rolling_shutter.turn", READOUT_TURN),
    ("rolling_shutter.shift", READOUT_SHIFT),
)
KINDS = {
    "late": Kind(late, "sync_offset", (("sync_offset.late", LATE_S),)),
    "in time": Kind(in_time),
    "blind": Kind(blind, "sync_offset"),
    "still": Kind(still),
    "flex": Kind(flex, "rig_flex", (("rig_flex.turn", FLEX_TURN), ("rig_flex.shift", FLEX_SHIFT))),
    "slip": Kind(slip, "rig_slip", (("rig_slip.turn.z", -SLIP[2]), ("rig_slip.shift.x", -SLIP[3]))),
    "sheet": Kind(sheet, "board_flex", (("board_flex.xx", BEND), ("board_flex.yy", BEND))),
    "readout": Kind(readout, "rolling_shutter", READOUT_NUMBERS),
    "readout of one": Kind(readout_of_one, "rolling_shutter", READOUT_NUMBERS),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=20, help="rigs of each kind (default: 20)")
    parser.add_argument("--kind", choices=KINDS, action="append", help="only this kind")
    options = parser.parse_args()
    console = Console(soft_wrap=True)
    for name in options.kind or KINDS:
        _print_kind(console, name, KINDS[name], options.rigs)


def _print_kind(console: Console, name: str, kind: Kind, rigs: int) -> None:
    right, errors, families = 0, [], 0
    baselines: list[tuple[float, float]] = []
    for seed in range(rigs):
        diagnosis, before_after = diagnosed(kind, seed)
        baselines.append(before_after)
        right += diagnosis.accepted == ((kind.effect,) if kind.effect else ())
        families += bool(diagnosis.families)
        numbers = {
            key: number for effect in diagnosis.found for key, number in effect.parameters.items()
        }
        errors += [
            (numbers[key].value - true) / numbers[key].sigma
            for key, true in kind.true
            if key in numbers
        ]
    expected = kind.effect or "nothing"
    line = f"{name}: {expected} found alone in {right} of {rigs}"
    if families:
        line += f", as a family in {families}"
    if errors:
        line += f"; error over sigma {_rms(np.array(errors)):.2f}"
    error_before, error_after = _rms(np.array(baselines)[:, 0]), _rms(np.array(baselines)[:, 1])
    console.print(
        f"{line}; baseline off by {error_before:.2f} mm before, {error_after:.2f} mm after"
    )


def diagnosed(kind: Kind, seed: int) -> tuple[RigDiagnosis, tuple[float, float]]:
    """Return the diagnosis of one rig, and the error of its baseline before and after, mm."""
    rng = np.random.default_rng(seed)
    bare = simulate_rig(seed, WINDOW, placements=1, amplitude=0.0, board=Board(6, 5, 0.03))
    simulated = kind.make(rng, bare)
    with tempfile.TemporaryDirectory() as folder:
        rig = fit_rig(simulated.write(Path(folder) / "rig"), Settings(grid=(1, 1), flat_board=True))
    better, diagnosis = diagnose_rig(rig)
    true = float(simulated.cameras["right"].mounting[3:].norm())
    baselines_m = rig.baselines[0].metres, better.baselines[0].metres
    return diagnosis, (1e3 * (baselines_m[0] - true), 1e3 * (baselines_m[1] - true))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main()

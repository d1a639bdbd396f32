"""The answers of the diagnosis when an effect of known size is hidden: `python -m
benchmarks.diagnosis [--views 20] [--seeds 3] [--clean 40]`.

Each session has so many views of 81 corners, 0.1 px noise per axis, uneven glass of 1.15 mm (none
for flat_port, entrance_pupil), and one effect at once, three and ten times the smallest size that
moves a corner by the noise: the largest shift over all corners, poses refitted, is then 0.1, 0.3
and 1 px. Absorbed is the part of the shift's sum of squares that the fit of the glass takes up; a
diagnosis can see the rest.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.hidden import NOISE, Hidden
from benchmarks.workers import add_workers, workers_of
from calib.calibration import Calibration
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.finding import Diagnosis
from calib.effects.effect import Effect
from calib.effects.registry import EFFECTS
from calib.fit_record.request import Settings
from calib.progress import Silent
from calib.threads import single_thread
from fixtures.calibrated import GLASS, calibrate
from fixtures.synthetic import scene

SIZES = (1, 3, 10)
ABSORBED = 0.95
"""A session of which the fit takes up more is not judged: its effect is not there to be seen."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of one hidden effect."""

    said: str
    """right, by name or by a family that the truth is in, wrong, missed, or
    unseen: so large that some corner is out of sight, a window in air thicker than 20 mm, or a
        pupil beyond its prior.
    """
    wrong: tuple[str, ...] = ()
    shift: float = float("nan")
    """px RMS, poses refitted."""
    absorbed: float = float("nan")
    seconds: float = float("nan")

    @property
    def judged(self) -> bool:
        return self.absorbed < ABSORBED


@dataclass(slots=True)
class Row:
    """All outcomes of one effect, by size."""

    name: str
    outcomes: dict[int, list[Outcome]] = field(default_factory=dict)

    def cells(self) -> Iterator[str]:
        for size in SIZES:
            outcomes = self.outcomes.get(size, [])
            counts = Counter(outcome.said for outcome in outcomes)
            if counts["unseen"] == len(outcomes):
                yield "unseen"
                continue
            visible = [outcome for outcome in outcomes if outcome.said != "unseen"]
            absorbed = np.median([outcome.absorbed for outcome in visible])
            shift = np.median([outcome.shift for outcome in visible])
            judged = sum(outcome.judged for outcome in visible)
            yield (
                f"{counts['right']}/{counts['wrong']}/{counts['missed']} ({judged}; {shift:.3f} px,"
                f" {100 * absorbed:.0f} %)"
            )


def finding_of(fit: Calibration) -> Diagnosis:
    """Return the finding that a person would read."""
    return diagnose(fit, Silent())[1]


def outcome(hidden: Hidden, size: int) -> Outcome:
    """Hide it, fit, and diagnose."""
    if not hidden.possible(size):
        return Outcome("unseen")
    fit = calibrate(hidden.session(size), Settings())
    start_time = time.process_time()
    finding = finding_of(fit)
    spent = time.process_time() - start_time
    truth = hidden.effect.name
    families = [family.members.keys() for family in finding.families if truth in family.members]
    wrong = tuple(
        name
        for name in finding.accepted
        if name != truth and not any(name in members for members in families)
    )
    message = "wrong" if wrong else "right" if finding.accepted else "missed"
    shift = float(np.sqrt((hidden.shift(size) ** 2).sum(-1).mean()))
    return Outcome(message, wrong, shift, hidden.absorbed(size, fit), spent)


def hidden_one(kind: type[Effect], seed: int, views: int) -> dict[int, Outcome]:
    """One effect at all sizes; empty where it cannot be seen."""
    with single_thread():
        hidden = Hidden.drawn(kind, seed, views)
        return {size: outcome(hidden, size) for size in SIZES} if hidden else {}


def port(seed: int, views: int) -> Outcome:
    """A port under water, which has no size."""
    with single_thread():
        return outcome(Hidden.under_water(seed, views), 1)


def alarm(seed: int, views: int) -> str:
    """Return the finding in a session without any effect."""
    with single_thread():
        made = scene(2000 + seed, views, (4, 4), 1e-5, NOISE, cover=GLASS)
        return "+".join(finding_of(calibrate(made, Settings())).accepted) or "none"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--views", type=int, default=20)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument(
        "--first",
        type=int,
        default=10,
        help="the first seed; 0 to 9 were looked at when the loop was made",
    )
    parser.add_argument("--clean", type=int, default=40)
    parser.add_argument("--effects", nargs="*", default=[kind.name for kind in EFFECTS])
    add_workers(parser)
    options = parser.parse_args()
    console = Console(width=150)
    seeds = range(options.first, options.first + options.seeds)
    rows, views = [], options.views
    with workers_of(options) as pool:
        requested = {
            kind: [pool.submit(hidden_one, kind, seed, views) for seed in seeds]
            for kind in EFFECTS
            if kind.name in options.effects
        }
        in_water = [pool.submit(port, seed, views) for seed in seeds]
        clean = [pool.submit(alarm, options.first + seed, views) for seed in range(options.clean)]
        for kind, result in requested.items():
            rows.append(Row(kind.name))
            for item in track(result, kind.name, transient=True):
                for size, message in item.result().items():
                    rows[-1].outcomes.setdefault(size, []).append(message)
            console.print(rows[-1].name, *rows[-1].cells(), highlight=False)
        ports = [item.result() for item in track(in_water, "water", transient=True)]
        false = Counter(item.result() for item in track(clean, "clean", transient=True))
        scaled = pool.scaled
    table = Table(
        "effect",
        *(f"{size} x" for size in SIZES),
        title=f"{views} views: right/wrong/missed (judged; shift RMS, absorbed)",
    )
    for shown in rows:
        table.add_row(shown.name, *shown.cells())
    console.print(table)
    for size in SIZES:
        judged = [o for shown in rows for o in shown.outcomes.get(size, []) if o.judged]
        right = sum(o.said == "right" for o in judged)
        console.print(
            f"{size} x: {right} of {len(judged)} named right, of those absorbed by less than"
            f" {100 * ABSORBED:.0f} %."
        )
    water = Counter(o.said for o in ports)
    console.print(
        f"A port under water: right {water['right']}, wrong {water['wrong']}, missed"
        f" {water['missed']}."
    )
    entries = [o for shown in rows for result in shown.outcomes.values() for o in result]
    console.print(
        "Wrong names:",
        dict(Counter(name for o in entries for name in o.wrong)) or "none",
        f"in {len(entries)} sessions.",
    )
    console.print(
        f"A diagnosis took {np.nanmedian([o.seconds for o in entries]):.1f} s of CPU, at most"
        f" {np.nanmax([o.seconds for o in entries]):.1f} s."
    )
    console.print(f"False alarms in {options.clean} clean sessions: {dict(false)}.")
    console.print(scaled)


if __name__ == "__main__":
    main()

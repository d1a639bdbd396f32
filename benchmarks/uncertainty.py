"""Whether maps and numbers are as sure as they say: `python -m benchmarks.uncertainty`.

The first table repeats sessions of uneven glass that declare the truth, exactly. It compares the
undistorted position of pixels near the training corners with that of the true rays, after the rigid
motion of all rays that fits best at the training corners. A ratio of error to predicted sigma with
a root mean square of 1 is honest; above, the prediction is too small.

Then comes a table for each scene, with a row for each kind of declaration and of variation. Each
session has new poses, noise and declarations. Declarations are:

    true       the truth, with the tolerance of each kind of number
    drawn      numbers with errors drawn from these tolerances
    calliper   numbers that state a quarter of the tolerance, with errors drawn from that

Variations are:

    clean      none
    focal      a focal length for each view, by 0.1 %
    centre     a principal point for each view, by 0.5 px
    bend       a bend of the board for each view, by 0.1 mm
    stretch    a print that is longer in one direction than in the other by 0.1 %

The columns of a row: the ratio of map error to predicted sigma, root mean square over the depths,
its median over sessions and its share above 2.5; the root mean square of (estimate - truth) / sigma
of each kind of number; the share of sessions that are called trusted; the count of numbers that are
called contradicted, though they keep to their tolerances; the share of sessions with any number
held, which has no sigma and is in no column; and the share of those whose glass is taken as even.

A run of two minutes:

    python -m benchmarks.uncertainty --repeats 0 --sessions 5 --scenes dome thin-cone
        --variations clean focal
"""

import argparse
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike
from rich.console import Console
from rich.table import Table

from benchmarks.workers import Workers, add_workers, workers_of
from calib.fit_record.request import Settings
from calib.fitting.declared import comparisons
from calib.fitting.setup import Setup
from calib.session.camera import Intrinsics
from calib.session.cover import Cover
from calib.session.freeing import ALL, AUTO, NONE
from calib.session.numbers import numbers_of
from calib.session.parameter_names import CAMERA as NAMES
from calib.session.parameter_names import number_of
from calib.threads import single_thread
from calib.verdict.judge import judge
from calib.verdict.verdict import Trust
from fixtures.calibrated import CAMERA, GLASS, calibrate, calibrated
from fixtures.map_errors import DEPTHS, error_over_sigma, errors
from fixtures.synthetic import COVERS, INTRINSICS, measured, misdeclared, scene
from fixtures.view_variation import VARIATIONS

VIEWS = 20
NOISE = 0.1
"""px per axis"""
SCENE_DEPTHS = (0.4, 1.2)
"""m"""
TRUE, DRAWN, CALLIPER = DECLARATIONS = ("true", "drawn", "calliper")
CALLIPER_FRACTION = 0.25
FAR = 2.5
"""Standard deviations."""
CAMERA_KIND = "camera"
KIND_OF = {
    "inner_radius": "radius",
    "radius_slope": "slope",
    "axis_offset": "offsets",
    "centre": "offsets",
    "distance": "offsets",
    "tilt": "tilts",
    "thickness": "thickness",
    "refractive_index": "index",
}
"""The kind of a cover's number, by the part of its name before the dot. Others have no tolerance.
"""
KINDS = (CAMERA_KIND, *dict.fromkeys(KIND_OF.values()))


@dataclass(frozen=True)
class Outcome:
    """The outcome of one session."""

    ratio: float
    """The root mean square over the depths of map error over predicted sigma."""
    deviations: tuple[tuple[str, float], ...]
    """The kind of each estimated number, and its error in standard deviations."""
    contradicted: int
    """The count of declared numbers that are called contradicted."""
    trusted: bool
    held: bool
    """True if a number that has a tolerance was held."""
    even: bool
    """True if the glass was taken as even."""


def outcome(
    scene_name: str, declared: str, variation: str, seed: int, views: int, free: str
) -> Outcome:
    """Calibrate one session."""
    cover, amplitude = COVERS[scene_name]
    with single_thread():
        made = scene(
            seed, views, amplitude=amplitude, noise=NOISE, depths=SCENE_DEPTHS, cover=cover
        )
        cause = VARIATIONS[variation]
        made = cause.applied(made, cause.deviations(made, np.random.default_rng([seed, 1])))
        setup = Setup(made.board, CAMERA, *declaration(declared, cover, seed))
        result = calibrated(made, setup, Settings(free=(free,)))
        ratio = error_over_sigma(made, result)
        verdict = judge(result)
    rows = [row for row in comparisons(result) if kind_of(row.name)]
    true = numbers_of(INTRINSICS, cover)
    return Outcome(
        ratio=ratio,
        deviations=tuple(
            (kind_of(row.name), (row.estimate - true[row.name].value * row.per_si) / row.sigma)
            for row in rows
            if row.sigma
        ),
        contradicted=sum(row.contradicted for row in rows),
        trusted=verdict.word is Trust.TRUSTED,
        held=any(row.held for row in rows),
        even=result.relief is None,
    )


def declaration(declared: str, cover: Cover, seed: int) -> tuple[Intrinsics, Cover]:
    """Return the numbers that a session with this seed declares."""
    rng = np.random.default_rng([seed, 2])
    if declared == DRAWN:
        return misdeclared(rng, INTRINSICS, cover)
    if declared == CALLIPER:
        return measured(rng, INTRINSICS, cover, CALLIPER_FRACTION)
    return INTRINSICS, cover


def kind_of(name: str) -> str:
    """Return the kind of a number; an empty text if it has no tolerance."""
    if NAMES.has(name):
        return CAMERA_KIND
    return KIND_OF.get(number_of(name).partition(".")[0], "")


def cells(outcomes: Sequence[Outcome]) -> list[str]:
    """Return the cells of one row."""
    ratios = np.array([item.ratio for item in outcomes])
    deviations: dict[str, list[float]] = defaultdict(list)
    for item in outcomes:
        for kind, deviation in item.deviations:
            deviations[kind].append(deviation)
    squares = {kind: np.mean(np.square(values)) for kind, values in deviations.items()}
    return [
        f"{np.median(ratios):.2f}",
        percent(ratios > FAR),
        *(f"{squares[kind] ** 0.5:.2f}" if kind in squares else "" for kind in KINDS),
        percent([item.trusted for item in outcomes]),
        str(sum(item.contradicted for item in outcomes)),
        percent([item.held for item in outcomes]),
        percent([item.even for item in outcomes]),
    ]


def percent(flags: ArrayLike) -> str:
    """Return the percentage of (N,) flags that are true."""
    return f"{100 * np.mean(np.asarray(flags, np.float64)):.0f} %"


def scene_table(scene_name: str, options: argparse.Namespace, pool: Workers) -> Table:
    """Return the table of one scene."""
    table = Table(
        "declared",
        "variation",
        "map",
        f"> {FAR:g}",
        *KINDS,
        "trusted",
        "contradicted",
        "held",
        "even",
        title=f"{scene_name}, {options.sessions} sessions a row",
    )
    for declared, variation in product(options.declared, options.variations):
        rows = [
            (scene_name, declared, variation, seed, options.views, options.free)
            for seed in range(options.first, options.first + options.sessions)
        ]
        outcomes = list(pool.each(outcome, rows, f"{scene_name}, {declared}, {variation}"))
        table.add_row(declared, variation, *cells(outcomes))
    return table


def exact(seed: int, bumps: int, amplitude: float) -> list[tuple[float, float, float]]:
    """Return for each depth the mean squares of error, predicted sigma and their ratio."""
    with single_thread():
        made = scene(seed, VIEWS, (bumps, bumps), amplitude, NOISE, cover=GLASS)
        fitted_errors = errors(made, calibrate(made, Settings()))
        return [
            (float(np.mean(e**2)), float(np.mean(s**2)), float(np.mean((e / s) ** 2)))
            for e, s in fitted_errors
        ]


def exactly_declared(repeats: int, pool: Workers) -> Table:
    """Return the table of sessions that declare the truth, exactly."""
    table = Table(
        "glass",
        *(f"{depth} m: error, predicted px; ratio" for depth in DEPTHS),
        "ratio in all",
        title="The truth, exactly",
    )
    for bumps, amplitude in ((4, 1e-5), (10, 1e-5)):
        rows = [(seed, bumps, amplitude) for seed in range(100, 100 + repeats)]
        roots = np.sqrt(np.mean(list(pool.each(exact, rows, f"{bumps}x{bumps} bumps")), axis=0))
        row = (f"{error:.3f}, {sigma:.3f}; {ratio:.2f}" for error, sigma, ratio in roots)
        table.add_row(
            f"{bumps}x{bumps}, {amplitude:g} m", *row, f"{np.sqrt((roots[:, 2] ** 2).mean()):.2f}"
        )
    return table


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=50, help="sessions of the first table")
    parser.add_argument("--sessions", type=int, default=10, help="sessions of each other row")
    parser.add_argument("--scenes", nargs="+", choices=tuple(COVERS), default=tuple(COVERS))
    parser.add_argument("--declared", nargs="+", choices=DECLARATIONS, default=DECLARATIONS)
    parser.add_argument(
        "--variations", nargs="+", choices=tuple(VARIATIONS), default=tuple(VARIATIONS)
    )
    parser.add_argument("--views", type=int, default=24, help="views of these sessions")
    parser.add_argument("--first", type=int, default=2000, help="their first seed")
    parser.add_argument(
        "--free", choices=(AUTO, ALL, NONE), default=AUTO, help="how they are fitted"
    )
    add_workers(parser)
    options = parser.parse_args()
    console = Console(width=150)
    with workers_of(options) as pool:
        if options.repeats:
            console.print(exactly_declared(options.repeats, pool))
        for scene_name in options.scenes if options.sessions else ():
            console.print(scene_table(scene_name, options, pool))
        console.print(pool.scaled)


if __name__ == "__main__":
    main()

"""Whether the maps are as sure as they say: `python -m benchmarks.uncertainty [--repeats 50]
[--sessions 100] [--clean 40]`.

Each repeat draws new glass, new board poses and new noise, calibrates, and compares the undistorted
position of pixels near the training corners with that of the true rays, after the rigid motion of
all rays that fits best at the training corners. A ratio of error to predicted sigma with a root
mean square of 1 is honest; above, the prediction is too small.

The first table's sessions declare the truth, exactly. In the second, every declared number of cover
and intrinsics is drawn from its own
tolerance: the ratio of each session is that of its root mean squares over the depths, and what it
    has to say is counted. In the third,
again the truth: what it has to say is a false alarm.
"""

import argparse
from collections import Counter
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.workers import Workers, add_workers, workers_of
from calib.fit_record.request import Settings
from calib.fitting.declared import comparisons
from calib.fitting.stages import Setup
from calib.session.freeing import ALL, AUTO, NONE
from calib.threads import single_thread
from calib.verdict.judge import judge
from fixtures.calibrated import CAMERA, GLASS, calibrate, calibrated
from fixtures.map_errors import DEPTHS, errors
from fixtures.synthetic import INTRINSICS, misdeclared, paper_cone, scene

VIEWS = 20
NOISE = 0.1
"""px per axis"""
FIGURE = 3e-6
"""m: the bumps' height.

They overlap to six times as much: glass that is uneven by 20 um, twice what cheap windows are.
"""


@dataclass(frozen=True)
class Outcome:
    """The outcome of one session."""

    seed: int
    off: tuple[float, ...]
    """px RMS, by depth."""
    predicted: tuple[float, ...]
    contradicted: tuple[str, ...]
    word: str
    reasons: tuple[str, ...]

    @property
    def ratio(self) -> float:
        return float(np.sqrt(np.mean(np.square(self.off) / np.square(self.predicted))))


def outcome(seed: int, views: int, wrong: bool, free: str) -> Outcome:
    with single_thread():
        return _outcome(seed, views, wrong, free)


def _outcome(seed: int, views: int, wrong: bool, free: str) -> Outcome:
    cover = paper_cone()
    made = scene(seed, views, (4, 4), FIGURE, NOISE, cover=cover)
    said = (
        misdeclared(np.random.default_rng(seed), INTRINSICS, cover)
        if wrong
        else (INTRINSICS, cover)
    )
    fitted = calibrated(made, Setup(made.board, CAMERA, *said), Settings(free=(free,)))
    error, predicted = zip(
        *((np.sqrt(np.mean(e**2)), np.sqrt(np.mean(s**2))) for e, s in errors(made, fitted)),
        strict=True,
    )
    verdict = judge(fitted)
    contradicted = tuple(item.name for item in comparisons(fitted) if item.contradicted)
    return Outcome(
        seed,
        error,
        predicted,
        contradicted,
        verdict.word.value,
        tuple(reason.sentence for reason in verdict.reasons),
    )


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
    table = Table(
        "glass",
        *(f"{depth} m: error, predicted px; ratio" for depth in DEPTHS),
        "ratio in all",
        title="The truth, exactly",
    )
    for bumps, amplitude in ((4, 1e-5), (10, 1e-5)):
        rows = [(seed, bumps, amplitude) for seed in range(100, 100 + repeats)]
        roots = np.sqrt(np.mean(list(pool.each(exact, rows, f"{bumps}x{bumps} bumps")), axis=0))
        cells = (f"{error:.3f}, {sigma:.3f}; {ratio:.2f}" for error, sigma, ratio in roots)
        table.add_row(
            f"{bumps}x{bumps}, {amplitude:g} m", *cells, f"{np.sqrt((roots[:, 2] ** 2).mean()):.2f}"
        )
    return table


def spread(results: list[Outcome], title: str) -> Table:
    table = Table(
        "depth",
        "map error: median, root mean square, worst",
        "predicted: median",
        title=f"{len(results)} sessions, {title}",
    )
    deviation, predicted = (
        np.array([item.off for item in results]),
        np.array([item.predicted for item in results]),
    )
    for depth, error, sigma in zip(DEPTHS, deviation.T, predicted.T, strict=True):
        root = np.sqrt(np.mean(error**2))
        table.add_row(
            f"{depth} m",
            f"{np.median(error):.3f}, {root:.3f}, {error.max():.3f} px",
            f"{np.median(sigma):.3f} px",
        )
    return table


def said(console: Console, results: list[Outcome], title: str) -> None:
    console.print(spread(results, title))
    ratios = np.array([item.ratio for item in results])
    console.print(
        f"Map error over predicted sigma: median {np.median(ratios):.2f}, root mean square"
        f" {np.sqrt(np.mean(ratios**2)):.2f}, above 2.5 in {100 * np.mean(ratios > 2.5):.0f} %."
    )
    console.print(
        "Numbers called contradicted:"
        f" {dict(Counter(name for item in results for name in item.contradicted))}."
    )
    console.print(f"Verdicts: {dict(Counter(item.word for item in results))}.")
    for sentence, count in Counter(
        reason.split(":")[0][:90] for item in results for reason in item.reasons
    ).most_common():
        console.print(f"{count}: {sentence}", markup=False)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=50)
    parser.add_argument("--sessions", type=int, default=100)
    parser.add_argument("--clean", type=int, default=40)
    parser.add_argument(
        "--views",
        type=int,
        default=30,
        help="of those sessions: so many fill the picture at random",
    )
    parser.add_argument("--first", type=int, default=2000, help="their first seed")
    parser.add_argument(
        "--free", choices=(AUTO, ALL, NONE), default=AUTO, help="how they are fitted"
    )
    add_workers(parser)
    options = parser.parse_args()
    console = Console(width=140)
    with workers_of(options) as pool:
        if options.repeats:
            console.print(exactly_declared(options.repeats, pool))
        for count, wrong, title in (
            (options.sessions, True, "every number drawn"),
            (options.clean, False, "every number true"),
        ):
            if count:
                rows = [
                    (seed, options.views, wrong, options.free)
                    for seed in range(options.first, options.first + count)
                ]
                said(console, list(pool.each(outcome, rows, "Sessions")), title)
        console.print(pool.scaled)


if __name__ == "__main__":
    main()

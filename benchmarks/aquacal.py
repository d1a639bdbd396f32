"""Cameras over water, calibrated by Refracal and by AquaCal 2.1 from the same corners:
`python -m benchmarks.aquacal [--cameras N] [--frames N] [--rigs N] [--program NAME] [--level]
[--turn-deg SIGMA]`.

The data are those of AquaCal's own generator, scenario `realistic`: cameras 1.031 m above the water
look straight down at a ChArUco board of 12 by 9 squares of 60 mm, 0.2 to 1 m under water, with
0.5 px of noise. The scenario has twelve cameras, of which `--cameras` takes the first ones, and 30
frames. With `--turn-deg`, the cameras do not look straight down.

Both programs are given the same numbers, and estimate the same:

- focal lengths, principal points and the height of the first camera over the water, each off by a
  draw of FOCAL, CENTRE_PX and HEIGHT;
- the true lens distortion, the true indices of air and water and the true size of the board, which
  both hold;
- water that is square to the first camera's axis, which is true. Both estimate its tilt, or hold
  it with `--level`.

Refracal also reads the standard deviation of each declared number, and TILT for the tilt. AquaCal
starts from the same numbers, and takes no standard deviation. So `Refracal-weak` is a second run,
with standard deviations that are WEAK times as large and say little.

For Refracal, the water is a flat window: `outside_index` 1.333, and a sheet of 0.1 mm with the same
`refractive_index`. All cameras share it (`shared_cover`).

- focal: the error of fx and fy, root mean square.
- height: the error of each camera's distance from the water, root mean square.
- lengths: the error of the sides of the squares, 60 mm, of the board in other places, which at
  least two cameras see: root mean square and signed mean, from exact pixels (the calibration's own
  part), and from pixels with 0.5 px of noise.
- CPU: the calibration alone.

Each program triangulates for itself. AquaCal takes the point nearest to the rays, Refracal the one
whose projections are nearest to the pixels. From exact pixels this makes the larger part of the
difference between the two.

AquaCal needs opencv-python 4.13, which must not be installed over the OpenCV of Refracal. So
install it into a folder by itself, and add that folder to PYTHONPATH:
`pip install --no-deps --target FOLDER aquacal natsort pandas six tqdm`.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from fixtures.aquacal_rigs import (
    WEAK,
    Errors,
    Solution,
    Task,
    make_task,
    measure,
    solve_by_aquacal,
    solve_by_refracal,
    solve_nothing,
)

Array = NDArray[np.float64]

DECLARED = "declared"
"""The name of the row of the declared numbers."""
PROGRAMS: Mapping[str, Callable[[Task], Solution]] = {
    "AquaCal": solve_by_aquacal,
    "Refracal": lambda task: solve_by_refracal(task, 1.0),
    "Refracal-weak": lambda task: solve_by_refracal(task, WEAK),
}
"""The programs by the names of their rows."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cameras", type=int, default=12, help="2 to 12 (default: 12)")
    parser.add_argument("--frames", type=int, default=30, help="places of the board (default: 30)")
    parser.add_argument("--rigs", type=int, default=3, help="data sets (default: 3)")
    level = "both know that the water is square to the first camera's axis"
    parser.add_argument("--level", action="store_true", help=level)
    parser.add_argument("--program", choices=PROGRAMS, action="append", help="only this one")
    turn = "turn each further camera by a draw of this, about each axis (default: 0)"
    parser.add_argument("--turn-deg", type=float, default=0.0, metavar="SIGMA", help=turn)
    options = parser.parse_args()
    console = Console(soft_wrap=True)
    rows: dict[str, list[Errors]] = {}
    turn_rad = float(np.deg2rad(options.turn_deg))
    for seed in range(options.rigs):
        task = make_task(seed, options.cameras, options.frames, turn_rad, options.level)
        for name in (DECLARED, *(options.program or PROGRAMS)):
            solution = PROGRAMS[name](task) if name in PROGRAMS else solve_nothing(task)
            rows.setdefault(name, []).append(measure(task, solution, seed))
    count = f"{options.cameras} cameras, {options.frames} frames, {options.rigs} rigs"
    console.print(_table(count, rows))


def _table(title: str, rows: Mapping[str, Sequence[Errors]]) -> Table:
    table = Table(title=title)
    table.add_column("")
    for column in (
        "focal, %",
        "height, mm",
        "lengths, exact px, mm",
        "mean",
        "lengths, noisy px, mm",
        "mean",
        "lengths",
        "CPU, s",
    ):
        table.add_column(column, justify="right")
    for name, errors in rows.items():
        exact = 1000 * np.concatenate([row.exact for row in errors])
        noisy = 1000 * np.concatenate([row.noisy for row in errors])
        table.add_row(
            name,
            f"{100 * _rms(np.concatenate([row.focal for row in errors])):.3f}",
            f"{1000 * _rms(np.concatenate([row.height for row in errors])):.2f}",
            *(_length_cells(exact) + _length_cells(noisy)),
            f"{len(noisy)}",
            f"{np.mean([row.seconds for row in errors]):.1f}",
        )
    return table


def _length_cells(errors: Array) -> list[str]:
    """Return the root mean square and the signed mean of (L,) mm."""
    if not len(errors):
        return ["", ""]
    return [f"{_rms(errors):.3f}", f"{np.mean(errors):+.3f}"]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main()

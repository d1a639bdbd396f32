"""The cost of scipy's splines in the place of those of calib.undistortion.spline: `python -m
benchmarks.splines`.

For two components at once, over a 3280x2464 picture with nodes 64, 16 and 4 px apart. In pairs,
ours then scipy's, by the time of all threads; the ratio is the median of the pairs'. The values
must agree.
"""

import time
from collections.abc import Callable
from functools import partial
from statistics import median

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.interpolate import NdBSpline, make_interp_spline

from calib.undistortion.grids import grid_nodes
from calib.undistortion.spline import Spline
from fixtures.synthetic import HEIGHT, WIDTH

Array = NDArray[np.float64]

PAIRS = 15
SPACINGS = (64, 16, 4)
"""px between nodes: a smooth field, one with failures in it, a lens that needs fine nodes."""
POINTS = (2_000, 8_000, 40_000)
"""The number of points of one step of Newton's method."""
ROUNDING = 1e-9
"""px: coordinates of 3280 px in float64, whose errors grow at most 243-fold on their way to
coefficients.
"""


def main() -> None:
    table = Table("3280x2464, nodes of", "what", "ours, ms", "scipy over ours")
    for spacing in SPACINGS:
        columns, rows = (
            grid_nodes(WIDTH, spacing, 0.06 * WIDTH),
            grid_nodes(HEIGHT, spacing, 0.06 * HEIGHT),
        )
        at = np.stack(np.meshgrid(columns, rows), -1)
        values = at + 20 * np.sin(at[..., ::-1] / 500)
        ours, theirs = Spline.through(columns, rows, values), fitted(columns, rows, values)
        nodes = f"{len(columns)}x{len(rows)}"
        table.add_row(
            nodes,
            "fit",
            *pairs(
                partial(Spline.through, columns, rows, values),
                partial(fitted, columns, rows, values),
            ),
        )
        table.add_row(
            "", "fit, even knots", *pairs(partial(even, values), partial(scipy_even, values))
        )
        for count in POINTS:
            points = in_order(count)
            error = max(
                np.abs(a - b).max()
                for a, b in zip(ours.at(points), evaluated(theirs, points), strict=True)
            )
            assert error < ROUNDING, error
            table.add_row(
                "",
                f"{count} points",
                *pairs(partial(ours.at, points), partial(evaluated, theirs, points)),
            )
    Console(width=80).print(table)


def fitted(columns: Array, rows: Array, values: Array) -> NdBSpline:
    by_rows = make_interp_spline(rows, values, 3, check_finite=False)
    by_columns = make_interp_spline(columns, by_rows.c, 3, axis=1, check_finite=False)
    return NdBSpline((by_rows.t, by_columns.t), by_columns.c.swapaxes(0, 1), 3)


def evaluated(spline: NdBSpline, points: Array) -> tuple[Array, Array]:
    yx = np.ascontiguousarray(points[:, ::-1])
    return spline(yx), np.stack([spline(yx, nu=(0, 1)), spline(yx, nu=(1, 0))], -1)


def even(values: Array) -> Array:
    return Spline.through(
        np.arange(float(values.shape[1])), np.arange(float(values.shape[0])), values
    ).coefficients


def scipy_even(values: Array) -> Array:
    """make_interp_spline's, as coefficients of B-splines with even knots: a value less a sixth of
    its second derivative.
    """
    for _ in range(2):
        nodes = np.arange(float(len(values)))
        inner = values - make_interp_spline(nodes, values, 3, check_finite=False)(nodes, 2) / 6
        ends = (6 * values[i] - 4 * inner[i] - inner[j] for i, j in ((0, 1), (-1, -2)))
        first, last = ends
        values = np.concatenate([first[None], inner, last[None]]).swapaxes(0, 1)
    return values


def in_order(count: int) -> Array:
    """Row by row over the picture, as Newton's method has them, each moved from its place in the
    row by up to 20 px.
    """
    columns = round(np.sqrt(count * WIDTH / HEIGHT))
    xs, ys = np.linspace(25, WIDTH - 25, columns), np.linspace(25, HEIGHT - 25, count // columns)
    at = np.stack(np.meshgrid(xs, ys), -1).reshape(-1, 2)
    return np.asarray(at + 20 * np.sin(at[:, ::-1] / 300))


def pairs(ours: Callable[[], object], theirs: Callable[[], object]) -> tuple[str, str]:
    """Our median time, and the median ratio, after a first pair that does not count."""
    spent = [(seconds(ours), seconds(theirs)) for _ in range(PAIRS + 1)][1:]
    return (
        f"{1e3 * median(our_seconds for our_seconds, _ in spent):.2f}",
        f"{median(scipy_seconds / our_seconds for our_seconds, scipy_seconds in spent):.2f}",
    )


def seconds(work: Callable[[], object]) -> float:
    start_time = time.process_time()
    work()
    return time.process_time() - start_time


if __name__ == "__main__":
    main()

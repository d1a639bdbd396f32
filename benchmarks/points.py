"""The speed of many rays and points: `python -m benchmarks.points`.

A cone of the paper, uneven by 8x8 bumps of 30 um, 3280x2464 px. A million pixels' rays, and the
pixels of the points that these rays meet from 0.15 to 3 m, by `Calibration.rays` and `project`,
which take such numbers through the field of rays; to trace the field is within the time. Beside
them, in the same run: each traced (20,000 of them), and a camera without a cover in OpenCV, five
coefficients (cv2.undistortPoints, cv2.projectPoints). Medians of three, CPU seconds of one thread.
How far the field is from tracing is of the 20,000.
"""

import os
import time
from collections.abc import Callable
from statistics import median

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from calib import calibration as room
from calib.threads import single_thread
from fixtures.known import known
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, scene

MANY, FEW = 1_000_000, room.MIN_FIELD_POINTS - 1
BARS = {"rays": 3.0, "project": 1.0}
"""Million a second."""
LENS = np.array([-0.1, 0.02, 1e-4, 1e-4, 0.0])


def rate(count: int, work: Callable[[], object]) -> float:
    """Million a second."""
    spent = []
    for _ in range(3):
        room._point_field.cache_clear()
        start_time = time.process_time()
        work()
        spent.append(time.process_time() - start_time)
    return count / median(spent) / 1e6


def main() -> None:
    calibration = known(scene(1, views=1, grid=(8, 8), amplitude=3e-5), WIDTH, HEIGHT)
    rng = np.random.default_rng(0)
    pixels = rng.uniform([0, 0], [WIDTH - 1, HEIGHT - 1], (MANY, 2))
    origins, directions = calibration.rays(pixels)
    depth = rng.uniform(0.15, 3.0, MANY)
    points = origins + directions * ((depth - origins[:, 2]) / directions[:, 2])[:, None]
    matrix = np.array(
        [
            [INTRINSICS.fx.value, 0, INTRINSICS.cx.value],
            [0, INTRINSICS.fy.value, INTRINSICS.cy.value],
            [0, 0, 1],
        ]
    )
    traced, projected = calibration.rays(pixels[:FEW])[1], calibration.project(points[:FEW])
    errors = {
        "rays": (
            float(np.linalg.norm(traced - directions[:FEW], axis=1).max()) * INTRINSICS.fx.value
        ),
        "project": float(np.abs(calibration.project(points)[:FEW] - projected).max()),
    }
    work: dict[str, tuple[Callable[[], object], Callable[[], object], Callable[[], object]]] = {
        "rays": (
            lambda: calibration.rays(pixels),
            lambda: calibration.rays(pixels[:FEW]),
            lambda: cv2.undistortPoints(pixels[:, None], matrix, LENS),
        ),
        "project": (
            lambda: calibration.project(points),
            lambda: calibration.project(points[:FEW]),
            lambda: cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, LENS),
        ),
    }
    table = Table(
        "million a second", "many", "bar", "each traced", "times", "OpenCV, no cover", "worst, px"
    )
    cv2.setNumThreads(1)
    with single_thread():
        for name, (ours, one_call, theirs) in work.items():
            many, few_rate, peer = rate(MANY, ours), rate(FEW, one_call), rate(MANY, theirs)
            bar = f"{BARS[name]:g} {'met' if many >= BARS[name] else 'MISSED'}"
            table.add_row(
                name,
                f"{many:.2f}",
                bar,
                f"{few_rate:.3f}",
                f"{many / few_rate:.1f}",
                f"{peer:.2f}",
                f"{errors[name]:.1e}",
            )
    Console(width=120).print(table)
    print(f"Load of the machine in the last minute: {os.getloadavg()[0]:.1f}.")


if __name__ == "__main__":
    main()

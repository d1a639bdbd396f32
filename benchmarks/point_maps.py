"""What a session of points is worth beside boards, for the same glass: `python -m
benchmarks.point_maps [--views 6 10] [--points 100000]`.

A thin cone with bumps is calibrated from views of a screen of many points with 0.01 px of noise,
and from 24 views of a board of 9x9 corners with 0.05 px, at the same distances. The error of the
maps is that against the true rays, after the rigid motion of all rays that fits best, root mean
square at three depths over the part of the picture that has corners nearby; beside it the error
that the calibration predicts. The seconds are those of reading and fitting.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from calib.calibration import Calibration
from calib.fitting.corner_range import corners_at, covered_fraction
from calib.fitting.fit import fit
from calib.fitting.stages import Setup
from calib.progress import Silent
from fixtures.calibrated import CAMERA, tolerant
from fixtures.map_errors import DEPTHS, errors
from fixtures.point_sessions import DEPTHS as PLACES
from fixtures.point_sessions import POINT_NOISE, screen_scene, write_point_session
from fixtures.synthetic import INTRINSICS, THIN, Scene, scene

BOARDS = 24
CORNER_NOISE = 0.05
"""px per axis, of a detected corner (docs/corners.md)."""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.point_maps", description=__doc__)
    parser.add_argument("--views", type=int, nargs="+", default=[6, 10])
    parser.add_argument("--points", type=int, default=100000)
    options = parser.parse_args()
    depths = ", ".join(f"{depth:g}" for depth in DEPTHS)
    table = Table("views", "seconds", "coverage", f"map error at {depths} m, px", "predicted")
    made = scene(1, views=BOARDS, noise=CORNER_NOISE, cover=THIN, depths=PLACES)
    start = time.perf_counter()
    calibration = tolerant(made, Setup(made.board, CAMERA, INTRINSICS, made.cover))
    seconds = time.perf_counter() - start
    table.add_row(f"{BOARDS} boards of 81", *row(made, calibration, seconds))
    columns = round((1.6 * options.points) ** 0.5)
    for views in options.views:
        made = screen_scene(1, views, columns, round(columns / 1.6))
        with tempfile.TemporaryDirectory() as folder:
            session = write_point_session(Path(folder) / "session", made, POINT_NOISE)
            start = time.perf_counter()
            calibration = fit(session, progress=Silent())
            seconds = time.perf_counter() - start
        words = f"{views} of {made.board.count} points"
        table.add_row(words, *row(made, calibration, seconds))
    Console(width=90).print(table)


def row(made: Scene, calibration: Calibration, seconds: float) -> tuple[str, ...]:
    """Return the cells of a calibration's line."""
    covered = covered_fraction(calibration, corners_at(calibration)[:, :2])
    pairs = list(errors(made, calibration))
    rms = [f"{np.sqrt(np.mean(error**2)):.4f}" for error, _ in pairs]
    predicted = [f"{np.sqrt(np.mean(sigma**2)):.4f}" for _, sigma in pairs]
    return f"{seconds:.1f} s.", f"{100 * covered:.0f} %", ", ".join(rms), ", ".join(predicted)


if __name__ == "__main__":
    main()

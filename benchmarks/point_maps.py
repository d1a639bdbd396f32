"""What a screen is worth beside boards, for the same glass:
`python -m benchmarks.point_maps [--sessions 10]`.

Rendered sessions (fixtures/README.md): 24 pictures of a 9x9 board in `wet-cone`, and six and twelve
poses of a laptop's screen in `screen-clean`, through the same uneven cone, before the same camera,
with the same session.yaml. The boards' pictures are sharp and have noise of 1 to 1.5 grey levels,
the screen's are blurred by 1.5 px and have noise of 2. The error is that of the maps against the
renderer's rays, after the rigid motion of all rays that fits best at the corners, root mean square
over the part of the picture that has corners or points nearby. The seconds are those of reading and
fitting.

`--sessions` also simulates sessions of twelve poses, each with its own glass and poses, whose
points have the noise that they state and whose cover and intrinsics are declared with the errors
of `fixtures.rigs.DECLARED`, and prints how many times the predicted error their maps are off.
"""

import argparse
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.progress import Silent
from calib.session.session import read_session
from fixtures.map_errors import error_over_sigma
from fixtures.point_sessions import screen_scene, write_point_session
from fixtures.rays import DEPTHS, FIXTURES, map_error
from fixtures.rendered_screens import copy_views
from fixtures.rigs import declare_numbers

BOARDS = "wet-cone"
SCREEN = "screen-clean"
POSES = 12
"""Of a simulated session."""
NEAR = 40.0
"""px: a pixel counts with three corners, or averages of points, that near."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=0, help="simulated sessions")
    options = parser.parse_args()
    depths = ", ".join(f"{depth:g}" for depth in DEPTHS)
    title = f"Maps at {depths} m, thousandths of a pixel"
    columns = ("views", "time", "area", "error", "predicted")
    table = Table(*columns, title=title, box=None, padding=(0, 1, 0, 0))
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        boards = shutil.copytree(
            FIXTURES / BOARDS, folder / "boards", ignore=shutil.ignore_patterns(".*", "calibration")
        )
        table.add_row("24 boards", *row(boards))
        for views in (6, 12):
            screen = copy_views(SCREEN, folder / f"{views}", views)
            table.add_row(f"{views} of a screen", *row(screen))
    console = Console(width=80)
    console.print(table)
    if options.sessions:
        ratios = [simulated_ratio(seed) for seed in range(options.sessions)]
        rms = float(np.sqrt(np.mean(np.square(ratios))))
        console.print(
            f"{len(ratios)} simulated sessions of {POSES} poses: error over predicted {rms:.2f},"
            f" from {min(ratios):.2f} to {max(ratios):.2f}"
        )


def row(folder: Path) -> tuple[str, ...]:
    """Return the cells of a session's line."""
    start = time.perf_counter()
    calibration = fit(read_session(folder), Settings(), Silent())
    seconds = time.perf_counter() - start
    error = map_error(calibration, folder / "truth.npz", NEAR)
    with np.load(folder / "truth.npz") as file:
        share = error.pixels / len(file["pixels"])
    errors = ", ".join(f"{1e3 * value:.1f}" for value in error.in_gauge.values())
    predicted = ", ".join(f"{1e3 * value:.1f}" for value in error.predicted.values())
    return f"{seconds:.1f} s.", f"{100 * share:.0f} %", errors, predicted


def simulated_ratio(seed: int) -> float:
    """Return the map error over that predicted of a simulated session."""
    made = screen_scene(seed, POSES)
    with tempfile.TemporaryDirectory() as temporary:
        declared = declare_numbers(np.random.default_rng(seed), made.cover)
        session = Path(temporary) / "session"
        folder = write_point_session(session, made, seed=seed, declared=declared)
        calibration = fit(read_session(folder), Settings(), Silent())
    return error_over_sigma(made, calibration)


if __name__ == "__main__":
    main()

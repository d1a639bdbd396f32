"""What a screen is worth beside boards, for the same glass: `python -m benchmarks.point_maps`.

Rendered sessions (fixtures/README.md): 24 pictures of a 9x9 board in `wet-cone`, and six and twelve
poses of a laptop's screen in `screen-clean`, through the same uneven cone, before the same camera,
with the same session.yaml. The boards' pictures are sharp and have noise of 1 to 1.5 grey levels,
the screen's are blurred by 1.5 px and have noise of 2. The error is that of the maps against the
renderer's rays, after the rigid motion of all rays that fits best, root mean square over the part
of the picture that has corners or points nearby. The seconds are those of reading and fitting.
"""

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
from fixtures.rays import DEPTHS, FIXTURES, map_error
from fixtures.rendered_screens import copy_views

BOARDS = "wet-cone"
SCREEN = "screen-clean"
NEAR = 40.0
"""px: a pixel counts with three corners, or averages of points, that near."""


def main() -> None:
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
    Console(width=80).print(table)


def row(folder: Path) -> tuple[str, ...]:
    """Return the cells of a session's line."""
    start = time.perf_counter()
    calibration = fit(read_session(folder), Settings(), Silent())
    seconds = time.perf_counter() - start
    error = map_error(calibration, folder / "truth.npz", NEAR)
    with np.load(folder / "truth.npz") as file:
        share = error.pixels / len(file["pixels"])
    errors = ", ".join(f"{1e3 * value:.1f}" for value in error.by_depth.values())
    predicted = ", ".join(f"{1e3 * value:.1f}" for value in error.predicted.values())
    return f"{seconds:.1f} s.", f"{100 * share:.0f} %", errors, predicted


if __name__ == "__main__":
    main()

"""The time of a map, and its errors: `python -m benchmarks.maps`.

The 3280x2464 map of one depth from the ray field, against projecting the point behind every pixel
(of every 64th, scaled up), in the same run. Median of five.
"""

import resource
import time
from collections.abc import Callable
from statistics import median

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.undistortion.ray_field import RayField, ray_field
from fixtures.synthetic import HEIGHT, WIDTH, scene

DEPTH = 0.5  # m
EVERY = 8  # pixels, in each direction


def main() -> None:
    made = scene(1, views=1, grid=(8, 8), amplitude=3e-5)
    v = {name: float(made.values[f"camera.{name}"]) for name in ("fx", "fy", "cx", "cy")}
    rows, columns = np.mgrid[0:HEIGHT:EVERY, 0:WIDTH:EVERY].reshape(2, -1)
    points = np.column_stack(
        [
            (columns - v["cx"]) / v["fx"] * DEPTH,
            (rows - v["cy"]) / v["fy"] * DEPTH,
            np.full(rows.size, DEPTH),
        ]
    )

    def traced() -> torch.Tensor:
        return project(made.path, made.values, torch.from_numpy(points), MIDDLE)

    def field() -> RayField:
        return ray_field(made.path, made.values, WIDTH, HEIGHT)

    field_kept = field()
    whole_seconds, one_more, direct = (
        seconds(lambda: field().map_at(DEPTH)),
        seconds(lambda: field_kept.map_at(DEPTH)),
        seconds(traced) * EVERY**2,
    )
    made_map, true_map = field_kept.map_at(DEPTH), traced().numpy()
    error = np.hypot(
        made_map.x[rows, columns] - true_map[:, 0], made_map.y[rows, columns] - true_map[:, 1]
    )[made_map.valid[rows, columns]]
    table = Table("3280x2464, one depth", "seconds", "ratio")
    table.add_row("every pixel traced", f"{direct:.1f}", "1")
    table.add_row(
        "ray field and its map",
        f"{whole_seconds:.2f}",
        f"{direct / whole_seconds:.0f} times faster",
    )
    table.add_row(
        "another depth from the field", f"{one_more:.2f}", f"{direct / one_more:.0f} times faster"
    )
    Console().print(table)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(
        f"The map is off tracing by {np.nanmax(error):.5f} px at most; peak memory {peak:.2f} GB."
    )


def seconds(work: Callable[[], object]) -> float:
    """Median wall time of five runs after a first one."""
    work()
    spent = []
    for _ in range(5):
        start_time = time.perf_counter()
        work()
        spent.append(time.perf_counter() - start_time)
    return median(spent)


if __name__ == "__main__":
    main()

"""The speed of undistortion, and the benefit of a file that holds all depths: `python -m
benchmarks.undistort`.

A cone of the paper, uneven by 8x8 bumps of 30 um. Times are medians; the stream alternates frame by
frame with bare cv2.remap on the same maps into the same kind of buffer. Every figure has its bar,
and the exit code says whether all are met.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from calib.apply.undistorter import Undistorter
from calib.export.npz import read_field, write_npz
from calib.io.file_set import FileSet
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.progress import Silent
from fixtures.known import known
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, Scene, scene

FRAMES = 60
MAPS = 15
DEPTHS = (0.15, 0.3, 0.5, 1.0, 2.0, 10.0)
"""m, at which maps from the saved file are compared with tracing."""


class Time(NamedTuple):
    """s"""

    wall: float
    cpu: float
    """Return the time of all threads, which other users of the machine do not change."""


Row = tuple[str, float, float, str]
"""The name, the figure, its bar, and "at most" or "at least"."""
EVERY = 8
"""Pixels in each direction between those that are traced."""


def main() -> int:
    made = scene(1, views=1, grid=(8, 8), amplitude=3e-5)
    rows = [*streaming(made), new_map(made), depth_images(made), *saved(made)]
    table = Table("", "measured", "bar", "")
    for what, value, bar, text in rows:
        table.add_row(
            what, f"{value:.3g}", f"{text} {bar:g}", "met" if met(value, bar, text) else "MISSED"
        )
    Console(width=110).print(table)
    print(
        f"OpenCV {cv2.__version__}, {cv2.getNumThreads()} threads. Load of the machine in the last"
        f" minute: {os.getloadavg()[0]:.1f}."
    )
    return int(not all(met(*row[1:]) for row in rows))


def met(value: float, bar: float, text: str) -> bool:
    return value <= bar if text == "at most" else value >= bar


def streaming(made: Scene) -> list[Row]:
    undistorter = Undistorter(known(made, 1920, 1080), 0.5)
    rng = np.random.default_rng(0)
    rows: list[Row] = []
    for name, shape in (("colour", (1080, 1920, 3)), ("grey", (1080, 1920))):
        frame = rng.integers(0, 256, shape, dtype=np.uint8)
        ours, bare = np.empty_like(frame), np.empty_like(frame)
        ratios, spent = [], []
        for _ in range(FRAMES):
            took = seconds(partial(undistorter.undistort, frame, ours))
            ratios.append(
                took.wall
                / seconds(partial(cv2.remap, frame, *undistorter.maps, cv2.INTER_LINEAR, bare)).wall
            )
            spent.append(took)
        assert np.array_equal(ours, bare)
        rows.append(
            (
                (
                    f"stream 1920x1080 {name}, over bare cv2.remap"
                    f" ({1e3 * typical(spent).wall:.1f} ms)"
                ),
                median(ratios),
                1.1,
                "at most",
            )
        )
    return rows


def new_map(made: Scene) -> Row:
    field = known(made, WIDTH, HEIGHT).ray_field()
    took = typical(
        [seconds(partial(field.map_at, depth)) for depth in np.linspace(0.3, 1.0, MAPS).tolist()]
    )
    return (
        f"a new depth's map at {WIDTH}x{HEIGHT}, s (cpu {took.cpu:.3f})",
        took.wall,
        0.25,
        "at most",
    )


def depth_images(made: Scene) -> Row:
    rng = np.random.default_rng(0)
    frame = rng.integers(0, 256, (1232, 1640, 3), dtype=np.uint8)
    depths = [rng.uniform(0.3, 5.0, frame.shape[:2]).astype(np.float32) for _ in range(3)]
    undistorter, straight = Undistorter(known(made, 1640, 1232), depths[0]), np.empty_like(frame)

    def show(depth: NDArray[np.float32]) -> None:
        undistorter.at(depth).undistort(frame, straight)

    took = typical([seconds(partial(show, depths[i % 3])) for i in range(MAPS)])
    return (
        f"a depth for each pixel at 1640x1232, frames/s (cpu {took.cpu:.3f} s a frame)",
        1 / took.wall,
        5,
        "at least",
    )


def saved(made: Scene) -> list[Row]:
    calibration = known(made, WIDTH, HEIGHT)
    with tempfile.TemporaryDirectory() as folder:
        with FileSet(Path(folder)) as files:
            calibration.write(files)
            write_npz(calibration, (), files, Silent())
            files.commit()
        size = sum(path.stat().st_size for path in Path(folder).iterdir())
        field = read_field(Path(folder, "rays.npz"))
    v, h = np.mgrid[0:HEIGHT:EVERY, 0:WIDTH:EVERY].reshape(2, -1)
    k = INTRINSICS
    worst = 0.0
    for depth in DEPTHS:
        points = (
            np.column_stack(
                [(h - k.cx.value) / k.fx.value, (v - k.cy.value) / k.fy.value, np.ones(h.size)]
            )
            * depth
        )
        pixels = project(*calibration.model(), torch.from_numpy(points), MIDDLE).numpy()
        at = field.map_at(depth)
        error = np.hypot(at.x[v, h] - pixels[:, 0], at.y[v, h] - pixels[:, 1])[at.valid[v, h]]
        worst = max(worst, float(error.max()))
    return [
        ("a saved calibration with all depths, MB", size / 1e6, 2, "at most"),
        (
            f"its maps off tracing, every {EVERY}th pixel, {DEPTHS[0]:g}-{DEPTHS[-1]:g} m, px",
            worst,
            0.01,
            "at most",
        ),
    ]


def seconds(work: Callable[[], object]) -> Time:
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return Time(time.perf_counter() - wall, time.process_time() - cpu)


def typical(times: list[Time]) -> Time:
    return Time(median(t.wall for t in times), median(t.cpu for t in times))


if __name__ == "__main__":
    sys.exit(main())

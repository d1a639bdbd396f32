"""Debian's mrcal, by its own command and that command's defaults: run inside this process, so that
its solver can be timed apart, or as a person runs it, where it is told "command" before the model's
name.

Run by /usr/bin/python3, where Debian puts mrcal.
"""

import runpy
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import mrcal  # type: ignore[import-not-found]
import numpy as np

from benchmarks.peers.case import BOARD, Case
from benchmarks.peers.central import Floats, scorer
from benchmarks.peers.child import Fitted, main
from benchmarks.peers.command import Usage, run

COMMAND = "mrcal-calibrate-cameras"
TIMED = ("seed_stereographic", "optimize")
"""The functions that the command calls to get from corners to a model.

The command also reads, writes, and maps the uncertainty.
"""


class Clock:
    """Sums the wall time of calls."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def around(self, call: Callable[..., object]) -> Callable[..., object]:
        def timed(*args: object, **keywords: object) -> object:
            start_time = time.perf_counter()
            try:
                return call(*args, **keywords)
            finally:
                self.seconds += time.perf_counter() - start_time

        return timed


def fit(case: Case, which: str) -> Fitted:
    *switches, model = which.split()
    used: Usage | None = None
    clock = Clock()
    command = shutil.which(COMMAND)
    assert command
    with tempfile.TemporaryDirectory() as folder:
        corners = Path(folder, "corners.vnl")
        corners.write_text("# filename x y level\n" + "".join(_rows(case)))
        options = {
            "--corners-cache": [str(corners)],
            "--lensmodel": [f"LENSMODEL_{model}"],
            "--focal": [str(case.focal)],
            "--imagersize": [str(side) for side in case.size],
            "--object-spacing": [str(BOARD.square)],
            "--object-width-n": [str(BOARD.columns)],
            "--object-height-n": [str(BOARD.rows)],
            "--outdir": [folder],
        }
        command_line = [
            command,
            *(word for name, words in options.items() for word in (name, *words)),
            "view*.png",
        ]
        if switches:
            used = run(command_line)
        else:
            _run_here(command_line, clock)
        camera = mrcal.cameramodel(str(Path(folder, "camera-0.cameramodel")))

    version = subprocess.run(
        ["dpkg-query", "-W", "-f", "${Version}", "mrcal"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout

    def project(points: Floats) -> Floats:
        return np.asarray(mrcal.project(points, *camera.intrinsics()))

    return Fitted(
        f"mrcal {version}", used.seconds if used else clock.seconds, None, scorer(project), used
    )


def _run_here(command: list[str], clock: Clock) -> None:
    for name in TIMED:
        setattr(mrcal, name, clock.around(getattr(mrcal, name)))
    sys.argv = command
    with suppress(SystemExit):
        runpy.run_path(command[0], run_name="__main__")


def _rows(case: Case) -> list[str]:
    return [
        f"view{i:04d}.png {x:.17g} {y:.17g} 0\n"
        for i, pixels in enumerate(case.train.pixels)
        for x, y in pixels
    ]


if __name__ == "__main__":
    main(fit)

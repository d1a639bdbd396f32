"""The time and memory of `calib fit` for many points: `python -m benchmarks.size`.

From a file of corners or of points to the report, behind the paper's cone. Linear means that the
last two columns stay. There are three kinds:

    dense   ten views of a dense target, as a screen is
    board   ten views of one large board
    views   views of a board of 19x19 corners
"""

import argparse
import os
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

from fixtures.large import write_dense_session, write_session

FEW = 10
"""The views of a dense target or of a large board."""
OF_A_VIEW = 361
"""The corners of a board of which there are many views."""


def taken(command: list[str]) -> tuple[int, float, float, float]:
    """The exit code of a command; its wall clock and its processor's s; and the most memory, GB."""
    start_time = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stderr
    errors = process.stderr.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        print(errors.decode(errors="replace")[-400:], file=sys.stderr)
    return (
        process.returncode,
        time.monotonic() - start_time,
        used.ru_utime + used.ru_stime,
        used.ru_maxrss / 1e6,
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--corners", type=int, nargs="+", default=[1_000, 10_000, 100_000, 1_000_000]
    )
    parser.add_argument("--kinds", nargs="+", choices=("dense", "board", "views"))
    parser.add_argument("--grid", default="12x12", help="centres of uneven glass (default: 12x12)")
    options = parser.parse_args()
    kinds = options.kinds or ("dense", "board", "views")
    print(
        "| kind | corners | views | exit code | s | processor s | GB | processor ms a corner"
        " | KB a corner |\n|---|---|---|---|---|---|---|---|---|"
    )
    for kind, corners in product(kinds, options.corners):
        views = round(corners / OF_A_VIEW) if kind == "views" else FEW
        write = write_dense_session if kind == "dense" else write_session
        with TemporaryDirectory() as folder:
            # elsewhere, because a process counts the memory of the one that starts it
            with ProcessPoolExecutor(1, get_context("spawn")) as pool:
                count = pool.submit(write, Path(folder), corners, views).result()
            code, wall, processor, memory = taken(
                [sys.executable, "-m", "calib", "fit", folder, "--grid", options.grid]
            )
        cost = f"{1e3 * processor / count:.2f} | {1e6 * memory / count:.1f}"
        print(
            f"| {kind} | {count} | {views} | {code} | {wall:.0f} | {processor:.0f} | {memory:.2f}"
            f" | {cost} |",
            flush=True,
        )


if __name__ == "__main__":
    main()

"""The time and memory of `calib fit` for many corners: `python -m benchmarks.size [--corners 10000
100000 1000000]`.

Views of one large board behind the paper's cone, from a corners file to the report. Linear means
that the last two columns stay.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from fixtures.large import write_session


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
    parser.add_argument("--corners", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--views", type=int, default=10)
    options = parser.parse_args()
    print(
        "| corners | views | exit code | s | processor s | GB | processor ms a corner | KB a corner"
        " |\n|---|---|---|---|---|---|---|---|"
    )
    for corners in options.corners:
        with TemporaryDirectory() as folder:
            count = write_session(Path(folder), corners, options.views)
            code, wall, processor, memory = taken([sys.executable, "-m", "calib", "fit", folder])
        cost = f"{1e3 * processor / count:.2f} | {1e6 * memory / count:.1f}"
        print(
            f"| {count} | {options.views} | {code} | {wall:.0f} | {processor:.0f} | {memory:.2f} |"
            f" {cost} |",
            flush=True,
        )


if __name__ == "__main__":
    main()

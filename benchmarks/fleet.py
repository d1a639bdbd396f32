"""A fleet of simulated cameras, ten of them broken in ten ways, on this machine, whose workers are
killed as it goes: the figures of docs/fleet.md.

`python -m benchmarks.fleet 40` makes the sessions of 40 cameras, calibrates every fourth one's
session of an earlier day as its prior, and runs `calib batch`. Every 30 s a worker is killed by
signal 9, and once, halfway, the command itself, which is then started again. It prints what was
named, and the time. `--keep FOLDER` keeps sessions and fleet there.

`python -m benchmarks.fleet --alarms` prints how many fleets of normal numbers, without a fault,
have a camera that stands out.
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil

from calib.fleet.result import read_result
from fixtures.fleet import FAULTS, Line, write_fleet, write_session
from fixtures.fleet_results import made

OPTIONS = ("--grid", "4x4", "--folds", "2")
EVERY_S = 30.0
"""Between two deaths."""
FLEETS = 300
"""The number of fleets that are asked for false alarms."""
PRIORS = 4
"""Every so manieth camera has one, and so has the one whose fault shows only against it."""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("cameras", type=int, nargs="?", default=40)
    parser.add_argument("--keep", type=Path)
    parser.add_argument(
        "--every",
        type=float,
        default=EVERY_S,
        help="seconds between two deaths; 0: nothing is killed",
    )
    parser.add_argument("--alarms", action="store_true")
    options = parser.parse_args()
    if options.alarms:
        for count in (10, 30, 100):
            alarms = sum(bool(made(count, seed=seed).findings) for seed in range(FLEETS))
            print(f"{count} cameras: {100 * alarms / FLEETS:.1f} % of {FLEETS} fleets")
        return
    with TemporaryDirectory() as folder:
        run(options.keep or Path(folder), Line(options.cameras), options.every)


def run(folder: Path, line: Line, interval: float) -> None:
    start_time = time.monotonic()
    with_prior = [
        number
        for number in range(line.cameras)
        if number % PRIORS == 0 or line.fault(number) == "turned-cover"
    ]
    manifest = folder / "sessions" / "fleet.csv"
    if not manifest.exists():
        for number in with_prior:
            write_session(
                folder / "before" / line.name(number), line, number, sound=True, attempt=1
            )
        write_fleet(
            folder / "sessions",
            line,
            {n: folder / "priors" / "cameras" / line.name(n) for n in with_prior},
        )
    print(
        f"{line.cameras} sessions, {len(with_prior)} earlier ones:"
        f" {time.monotonic() - start_time:.0f} s",
        flush=True,
    )
    start_time = time.monotonic()
    command = [
        sys.executable,
        "-m",
        "calib",
        "batch",
        str(folder / "before" / "*"),
        "-o",
        str(folder / "priors"),
        *OPTIONS,
    ]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    print(f"their calibrations: {time.monotonic() - start_time:.0f} s", flush=True)
    start_time = time.monotonic()
    command = [
        sys.executable,
        "-m",
        "calib",
        "batch",
        str(manifest),
        "-o",
        str(folder / "fleet"),
        *OPTIONS,
        "--json",
    ]
    answer, deaths, restarts = hounded(command, folder / "fleet", line, interval)
    seconds = time.monotonic() - start_time
    names = set(answer["stand_out"])
    broken = {
        line.name(number): line.fault(number)
        for number in range(line.cameras)
        if line.fault(number)
    }
    results = [read_result(folder / "fleet", line.name(number)) for number in range(line.cameras)]
    finished = sum(result is not None for result in results)
    print(
        f"{finished} of {line.cameras} results in {seconds:.0f} s; {deaths} workers were killed,"
        f" and the command {restarts} times"
    )
    print(
        f"cameras took {sorted(r.seconds for r in results if r)[len(results) // 2]:.1f} s in the"
        f" median; states {answer['states']}"
    )
    print(
        f"named: {len(names & set(broken))} of {len(broken)} that are broken,"
        f" {len(names - set(broken))} of the others"
    )
    for camera, fault in broken.items():
        print(f"  {fault}: {'; '.join(answer['stand_out'].get(camera, ['NOT NAMED'])[:2])}")
    for camera in sorted(names - set(broken)):
        print(f"  whole, {camera}: {'; '.join(answer['stand_out'][camera][:2])}")


def hounded(command: list[str], fleet: Path, line: Line, interval: float) -> tuple[dict, int, int]:
    """Return the command's output, the number of workers that died, and that of its restarts."""
    deaths = restarts = 0
    chance = random.Random(1)
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    last = time.monotonic()
    while process.poll() is None:
        time.sleep(1)
        done = len(list((fleet / "cameras").glob("*.json")))
        if interval and not restarts and done > line.cameras / 2:
            process.send_signal(signal.SIGKILL)
            process.wait()
            restarts += 1
            process = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
            )
            last = time.monotonic()
        elif interval and time.monotonic() - last > interval:
            last = time.monotonic()
            workers = [
                child.pid
                for child in psutil.Process(process.pid).children()
                if "spawn_main" in " ".join(child.cmdline())
            ]
            if workers:
                with suppress(ProcessLookupError):
                    os.kill(chance.choice(workers), signal.SIGKILL)
                    deaths += 1
    assert process.stdout
    printed = process.stdout.read()
    if process.returncode:
        sys.exit(f"the command ended with {process.returncode}")
    return json.loads(printed), deaths, restarts


if __name__ == "__main__":
    assert len(FAULTS) == 10
    main()

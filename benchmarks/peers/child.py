"""The process of one peer: read a case, fit, say what it took, then score.

And how the benchmark starts one.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.peers.case import Case, Shots
from benchmarks.peers.command import ONE_THREAD, Usage

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True, slots=True)
class Fitted:
    """The result of a peer's fit."""

    version: str
    """The version of the software, in words."""
    seconds: float
    """Wall time from corners to model, after imports."""
    iterations: int | None
    """None where the software does not tell."""
    score: Callable[[Shots], float]
    """px RMS with each view's pose refitted."""
    command: Usage | None = None
    """The resources of the command that did the fit; None if this process did it."""


@dataclass(frozen=True, slots=True)
class Report:
    """The report of a peer's process."""

    version: str
    seconds: float
    cpu: float
    """s, of the whole process with its imports, up to the end of the fit; of the command that did
    it, all.
    """
    memory: float
    """MB, the most that the process held up to the end of the fit."""
    iterations: int | None
    test: float
    """px RMS"""
    near: float
    """px RMS"""


def main(fit: Callable[[Case, str], Fitted]) -> None:
    """The arguments are the case, the file for the report, and what the peer is to be told."""
    case_file, report_file, which = sys.argv[1:]
    case = Case.load(Path(case_file))
    done = fit(case, which)
    usage = resource.getrusage(resource.RUSAGE_SELF)
    used = done.command or Usage(done.seconds, usage.ru_utime + usage.ru_stime, _peak())
    report = Report(
        done.version,
        done.seconds,
        used.cpu,
        used.memory,
        done.iterations,
        done.score(case.test),
        done.score(case.near),
    )
    Path(report_file).write_text(json.dumps(asdict(report)))


def start(python: str, module: str, which: str, case: Case) -> Report | str:
    """Run one peer on a case: its report, or the last line of its complaint."""
    with tempfile.TemporaryDirectory() as folder:
        case_file, report_file = Path(folder, "case.npz"), Path(folder, "report.json")
        case.save(case_file)
        command = [
            python,
            "-W",
            "ignore",
            "-m",
            f"benchmarks.peers.{module}",
            str(case_file),
            str(report_file),
            which,
        ]
        ended = subprocess.run(
            command,
            cwd=ROOT,
            env={**os.environ, **ONE_THREAD},
            capture_output=True,
            text=True,
            check=False,
        )
        if ended.returncode:
            return (ended.stderr.strip().splitlines() or [f"exit code {ended.returncode}"])[-1]
        return Report(**json.loads(report_file.read_text()))


def _peak() -> float:
    """MB. Linux's own figure for this program: ru_maxrss would count the process that started
    it.
    """
    line = next(
        line
        for line in Path("/proc/self/status").read_text().splitlines()
        if line.startswith("VmHWM")
    )
    return int(line.split()[1]) * 1024 / 1e6

"""A whole command as a person runs it: what its process takes, from its start to its end."""

import os
import resource
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""The environment that keeps a peer on one thread."""


@dataclass(frozen=True, slots=True)
class Usage:
    """The resources of ended child processes."""

    seconds: float
    """Wall time."""
    cpu: float
    """s, user and system, of all threads."""
    memory: float
    """MB, the most that one held, or this process when it started one."""


def run(command: Sequence[str]) -> Usage:
    """Run a command with as many threads as it likes; its complaint is passed on."""
    initial, start_time = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    environment = {name: value for name, value in os.environ.items() if name not in ONE_THREAD}
    ended = subprocess.run(
        command,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    seconds, final = time.perf_counter() - start_time, resource.getrusage(resource.RUSAGE_CHILDREN)
    if ended.returncode:
        raise SystemExit(ended.stderr or f"exit code {ended.returncode}")
    cpu = final.ru_utime + final.ru_stime - initial.ru_utime - initial.ru_stime
    return Usage(seconds, cpu, final.ru_maxrss * 1024 / 1e6)

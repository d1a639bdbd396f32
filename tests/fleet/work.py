"""Work for the workers of tests, which import it by name."""

import os
import signal
import time
from collections.abc import Callable

from calib.fleet.job import Job
from calib.fleet.result import JobState, Result


def behave(job: Job) -> Result:
    """Do what the camera's name says, or end as a camera with too little data."""
    if act := ACTS.get(job.entry.id):
        act()
    return Result(job.entry.id, JobState.TOO_LITTLE, os.environ.get("OMP_NUM_THREADS", ""))


def crash() -> None:
    os._exit(7)


def be_killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def take_memory() -> None:
    """Take 1 GB, until somebody ends this."""
    taken = b"x" * (1 << 30)
    time.sleep(600 + len(taken) % 2)


ACTS: dict[str, Callable[[], None]] = {
    "crash": crash,
    "kill": be_killed,
    "memory": take_memory,
}

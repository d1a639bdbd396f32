"""A fleet's jobs on Dask: sent, sent again where a worker died, and collected as they end."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calib.errors import brief
from calib.fleet.cluster import FleetError
from calib.fleet.job import Job, run_job
from calib.fleet.result import Result, State

if TYPE_CHECKING:
    from distributed import Client

ATTEMPTS = 3
"""How often a camera is given to the cluster after that gave it up, for its workers died of it."""
RETURN_S = 60.0
"""How long a scheduler may be away."""


def run_jobs(client: Client, jobs: Sequence[Job]) -> Iterator[Result]:
    """Every camera's result, as they end.

    Raises:
        FleetError: the scheduler is gone; what was done until then lies in the fleet's folder.
    """
    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    left = {job.entry.id: job for job in jobs}
    tried: Counter[str] = Counter()
    while left:
        ids = list(left)
        futures = client.map(
            run_job,
            [left[each] for each in ids],
            pure=False,
            key=[f"{each}-{time.time_ns()}" for each in ids],
        )
        names = dict(zip((future.key for future in futures), ids, strict=True))
        for future in as_completed(futures):
            camera = names[future.key]
            if future.status == "cancelled" or future.status == "lost":
                break
            error = future.exception() if future.status == "error" else None
            if isinstance(error, KilledWorker):
                tried[camera] += 1
                if tried[camera] < ATTEMPTS:
                    continue
                sentence = (
                    f"Every worker that was given it died, {tried[camera]} times over: give workers"
                    " more memory with --memory."
                )
                yield _undone(left[camera], sentence)
            elif error:
                yield _undone(
                    left[camera],
                    f"No worker could begin it ({type(error).__name__}: {brief(error)}).",
                )
            else:
                yield future.result()
            del left[camera]
            future.release()
        if left and not _returned(client):
            raise FleetError(
                f"The scheduler of the cluster is gone, with {len(left)} of {len(jobs)} cameras"
                " left: run the same command again, and it goes on from there."
            )


def _undone(job: Job, sentence: str) -> Result:
    """A camera that no worker could say anything of."""
    result = Result(job.entry.id, State.FAILED, sentence)
    result.write(Path(job.fleet))
    return result


def _returned(client: Client) -> bool:
    """Whether the scheduler answers, once it had time to come back."""
    end = time.monotonic() + RETURN_S
    while time.monotonic() < end:
        if client.status == "running":
            return True
        if client.status in ("closed", "closing"):
            return False
        time.sleep(0.2)
    return False

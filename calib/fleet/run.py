"""A fleet's jobs on Dask: they are sent, sent again when the scheduler was away, and collected."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from calib.errors import brief
from calib.fleet.cluster import SCHEDULER_PATIENCE_S, FleetError
from calib.fleet.heartbeat import Heartbeat, listed
from calib.fleet.job import Job, give_up, run_job
from calib.fleet.result import Result
from calib.io.numerals import counted

if TYPE_CHECKING:
    from distributed import Client, Future

RETURN_S = 60.0
"""The longest time that a scheduler may be away."""
POLL_S = 0.2
COUNT_S = 1.0
"""The time between two counts of the scheduler's workers."""


def run_jobs(
    client: Client,
    jobs: Sequence[Job],
    say: Callable[[str], None],
    patience_s: float = SCHEDULER_PATIENCE_S,
) -> Iterator[Result]:
    """Yield every camera's result when it ends.

    Args:
        say: gets a line when no camera finishes for a minute.
        patience_s: how long the cluster may have no worker.

    Raises:
        FleetError: the scheduler or all workers are gone; the results until then lie in the fleet's
            folder.
    """
    from distributed import as_completed

    remaining = {job.entry.id: job for job in jobs}
    watch = _Watch(client, say, patience_s)
    # Cameras of which workers died, perhaps because of one beside them: each is tried once alone.
    suspects: set[str] = set()
    while remaining:
        waiting = deque(sorted(remaining.values(), key=lambda job: job.entry.id in suspects))
        sent: dict[str, Job] = {}
        completed = as_completed(loop=client.loop)
        while (waiting or not completed.is_empty()) and client.status == "running":
            watch.check(remaining, len(jobs))
            # Dask blames a death on all cameras that the worker was given, so none waits there.
            while waiting and completed.count() < max(1, watch.threads):
                if waiting[0].entry.id in suspects and completed.count():
                    break
                job = waiting.popleft()
                key = f"{job.entry.id}-{time.time_ns()}"
                sent[key] = job
                completed.add(client.submit(run_job, job, pure=False, key=key))
            batch = completed.next_batch(block=False)
            if any(future.status in ("cancelled", "lost") for future in batch):
                break
            for future in batch:
                job = sent[future.key]
                if _is_killed(future) and job.entry.id not in suspects:
                    suspects.add(job.entry.id)
                    waiting.append(job)
                    continue
                result = _result(future, job)
                if result:
                    watch.heartbeat.finish()
                    yield result
                    del remaining[job.entry.id]
            if not batch:
                time.sleep(POLL_S)
        if remaining and not _returned(client):
            raise FleetError(
                f"The scheduler of the cluster is gone, and {_unfinished(remaining, len(jobs))}:"
                " run the same command again, and it goes on from there."
            )


class _Watch:
    """Counts the cluster's workers, and says so once a minute while no camera finishes."""

    def __init__(self, client: Client, say: Callable[[str], None], patience_s: float) -> None:
        self.heartbeat = Heartbeat(say)
        self.threads = 0
        """Cameras that the workers calibrate at once."""
        self._client = client
        self._patience_s = patience_s
        self._workers = 0
        self._counted_at = 0.0
        self._connected_at = time.monotonic()

    def check(self, remaining: Mapping[str, Job], total: int) -> None:
        """FleetError if no worker was connected for too long."""
        time_s = time.monotonic()
        if time_s - self._counted_at >= COUNT_S:
            self._counted_at = time_s
            with suppress(OSError, TimeoutError):  # the scheduler has just gone
                threads = self._client.nthreads()
                self._workers = len(threads)
                self.threads = sum(threads.values())
            if self._workers:
                self._connected_at = time_s
        if time_s - self._connected_at > self._patience_s:
            raise FleetError(
                f"No worker was connected for {self._patience_s / 60:.0f} min, and"
                f" {_unfinished(remaining, total)}: start workers, or look for the reason in the"
                " logs of the queue's jobs, and run the same command again: it goes on from there."
            )
        self.heartbeat.speak(lambda: self._describe(remaining))

    def _describe(self, remaining: Mapping[str, Job]) -> str:
        """Return what the fleet waits for, for the heartbeat."""
        workers = counted(self._workers, "worker") if self._workers else "no worker"
        cameras = counted(len(remaining), "camera")
        return f"{workers} connected, {cameras} not done ({listed(list(remaining))})"


def _unfinished(remaining: Mapping[str, Job], total: int) -> str:
    """Return which cameras have no result, as a clause."""
    return f"{len(remaining)} of {total} cameras are not done ({listed(list(remaining))})"


def _is_killed(future: Future) -> bool:
    """Return True if Dask gave the camera up, because too many of its workers died."""
    from distributed.scheduler import KilledWorker

    return future.status == "error" and isinstance(future.exception(), KilledWorker)


def _result(future: Future, job: Job) -> Result | None:
    """Return a camera's result; None if its worker died before it handed the result over."""
    from distributed.scheduler import KilledWorker

    error = future.exception() if future.status == "error" else None
    if isinstance(error, KilledWorker):
        return give_up(
            job,
            f"It was given up, because {counted(error.allowed_failures + 1, 'worker')} of the"
            " cluster died of it: give workers more memory with --memory.",
        )
    if error:
        return give_up(job, f"No worker could begin it ({type(error).__name__}: {brief(error)}).")
    try:
        result: Result = future.result(timeout=RETURN_S)
    except Exception:  # the next round takes it from the fleet's folder
        return None
    return result


def _returned(client: Client) -> bool:
    """Return True if the scheduler answers, once it had time to come back."""
    end = time.monotonic() + RETURN_S
    while time.monotonic() < end:
        if client.status == "running":
            return True
        if client.status in ("closed", "closing"):
            return False
        time.sleep(POLL_S)
    return False

"""A fleet on this machine: worker processes that exchange cameras and results with this process
over unnamed pipes.

Nothing listens: there is no port, no file and no name to which another account of the machine could
connect. A worker calibrates one camera at a time. If it dies, another takes its place.
"""

from __future__ import annotations

import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess

from calib.fleet.cluster import FleetError, Place
from calib.fleet.heartbeat import Heartbeat, listed
from calib.fleet.job import Job, give_up, run_job
from calib.fleet.machine import core_count, memory_bytes, resident_bytes
from calib.fleet.result import Result
from calib.io.numerals import counted

FIT_BYTES = 2 << 30
"""Memory that one camera may need: 0.44 GB were measured for twenty views of corners, and pictures
are decoded one a thread.
"""
ATTEMPTS = 3
"""Workers that may die of a camera (of memory, or a crash) before it is given up: the same camera
takes as much memory the next time.
"""
KILLED_ATTEMPTS = 20
"""Workers that another program may kill while they calibrate a camera, before it is given up: the
camera is hardly the cause.
"""
START_ATTEMPTS = 5
"""Workers in a row that may die before they are ready."""
POLL_S = 0.2
"""The time between two readings of the workers' memory."""
EXIT_S = 10.0
"""The longest time between the end of a worker's pipe and its exit."""
THREAD_LIMITS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""A fit is thousands of small operations, which threads only slow down."""
ADVICE = "Give workers more memory with --memory, or start fewer with --workers"

_SPAWN = get_context("spawn")
_READY = None
"""A worker's first message, when its libraries are loaded."""

Work = Callable[[Job], Result]


def local_workers(place: Place) -> tuple[int, int]:
    """Return the number of workers on this machine, and the bytes that each may take.

    There is one worker a core, as far as the memory reaches.
    """
    memory = memory_bytes()
    workers = place.workers or max(1, min(core_count(), memory // (place.memory or FIT_BYTES)))
    return workers, place.memory or memory // workers


def run_locally(
    jobs: Sequence[Job], place: Place, say: Callable[[str], None], work: Work = run_job
) -> Generator[Result, None, None]:
    """Yield every camera's result when it ends. Closing the iterator ends the workers.

    Args:
        say: gets a line when a worker dies, and when no camera finishes for a minute.
        work: calibrates one camera; workers import it by its name.

    Raises:
        FleetError: no worker can start; the results until then lie in the fleet's folder.
    """
    workers, memory = local_workers(place)
    pool = _Pool(jobs, workers, memory, say, work)
    try:
        yield from pool.results()
    finally:
        pool.close()


@dataclass(slots=True, eq=False)
class _Worker:
    """A process, and this process's end of its pipe."""

    process: SpawnProcess
    pipe: Connection
    ready: bool = False
    job: Job | None = None
    excess: int = 0
    """Bytes that it took when it was killed for taking too many; otherwise 0."""

    def send(self, job: Job) -> None:
        """Give it a camera. If the worker has died, `receive` finds that."""
        self.job = job
        with suppress(OSError):
            self.pipe.send(job)

    def end(self) -> int:
        """Wait until the process has exited, kill it if it does not, and return its exit code: that
        of the process, or the signal that killed it, negative.
        """
        self.process.join(EXIT_S)
        self.process.kill()
        self.process.join()
        code = self.process.exitcode or 0
        self.process.close()
        self.pipe.close()
        return code


class _Pool:
    """The workers, and the cameras that wait for one."""

    def __init__(
        self,
        jobs: Sequence[Job],
        count: int,
        memory: int,
        say: Callable[[str], None],
        work: Work,
    ) -> None:
        self._waiting = deque(jobs)
        self._total = len(jobs)
        self._count = count
        self._memory = memory
        self._say = say
        self._work = work
        self._workers: list[_Worker] = []
        self._deaths: Counter[tuple[str, int]] = Counter()
        """The number of deaths, by camera and by the limit that holds for their cause."""
        self._failed_starts = 0

    def results(self) -> Iterator[Result]:
        heartbeat = Heartbeat(self._say)
        while self._waiting or self._busy():
            while len(self._workers) < min(self._count, len(self._waiting) + len(self._busy())):
                self._workers.append(_started(self._work))
            wait([worker.pipe for worker in self._workers], POLL_S)
            for worker in tuple(self._workers):
                result = self._serve(worker)
                if result:
                    heartbeat.finish()
                    yield result
            self._limit_memory()
            heartbeat.speak(self._describe)

    def close(self) -> None:
        """Kill the workers."""
        for worker in self._workers:
            worker.process.kill()
        while self._workers:
            self._workers.pop().end()

    def _busy(self) -> list[_Worker]:
        return [worker for worker in self._workers if worker.job]

    def _serve(self, worker: _Worker) -> Result | None:
        """Take a worker's message or note its death, give it the next camera, and return the result
        of a camera that has ended.
        """
        result: Result | None = None
        try:
            if worker.pipe.poll():
                result = worker.pipe.recv()
                worker.ready = True
                worker.job = None
                self._failed_starts = 0
        except (EOFError, OSError):
            return self._bury(worker)
        if worker.ready and not worker.job and self._waiting:
            worker.send(self._waiting.popleft())
        return result

    def _bury(self, worker: _Worker) -> Result | None:
        """Remove a worker that has died, and return the failure of a camera that is given up."""
        code = worker.end()
        self._workers.remove(worker)
        cause = self._cause(worker, code)
        if not worker.job:
            if not worker.ready:
                self._count_failed_start(cause)
            return None
        camera = worker.job.entry.id
        killed = code in (-signal.SIGKILL, -signal.SIGTERM) and not worker.excess
        limit = KILLED_ATTEMPTS if killed else ATTEMPTS
        self._deaths[camera, limit] += 1
        deaths = self._deaths[camera, limit]
        if deaths < limit:
            self._waiting.append(worker.job)
            self._say(
                f"A worker died while it calibrated {camera}: it {cause}. The camera is tried"
                f" again ({deaths + 1} of {limit})."
            )
            return None
        advice = f" {ADVICE}." if worker.excess or code == -signal.SIGKILL else ""
        return give_up(
            worker.job,
            f"{counted(deaths, 'worker')} died while they calibrated it, and it was given up: the"
            f" last one {cause}.{advice}",
        )

    def _count_failed_start(self, cause: str) -> None:
        """Count a worker that died before it was ready; at the limit, go on with those that are
        ready.
        """
        self._failed_starts += 1
        self._say(
            f"A worker died while it started: it {cause} ({self._failed_starts} of"
            f" {START_ATTEMPTS} in a row)."
        )
        if self._failed_starts < START_ATTEMPTS:
            return
        self._failed_starts = 0
        self._count = sum(worker.ready for worker in self._workers)
        if self._count:
            self._say(f"No more workers are started; {counted(self._count, 'worker')} go on.")
            return
        cameras = [job.entry.id for job in self._waiting]
        raise FleetError(
            f"No worker can start: {START_ATTEMPTS} in a row died, and the last one {cause}."
            f" {len(cameras)} of {self._total} cameras are not done ({listed(cameras)}). {ADVICE},"
            " and run the same command again: it goes on from there."
        )

    def _cause(self, worker: _Worker, code: int) -> str:
        """Return what ended a worker, as the end of a sentence."""
        if worker.excess:
            return f"took {_megabytes(worker.excess)}, and may take {_megabytes(self._memory)}"
        if code == -signal.SIGKILL:
            return "was killed by signal 9, as the system does when memory runs out"
        if code < 0:
            return f"was killed by signal {-code} ({signal.strsignal(-code)})"
        return f"ended with exit code {code}"

    def _limit_memory(self) -> None:
        """Kill the workers that take more memory than they may."""
        for worker in self._workers:
            taken = resident_bytes(worker.process.pid or 0)
            if taken > self._memory and not worker.excess:
                worker.excess = taken
                worker.process.kill()

    def _describe(self) -> str:
        """Return what the workers do, for the heartbeat."""
        busy = [worker.job.entry.id for worker in self._workers if worker.job]
        starting = sum(not worker.ready for worker in self._workers)
        lines: list[str] = []
        if busy:
            lines.append(f"{counted(len(busy), 'worker')} at {listed(busy)}")
        if starting:
            lines.append(f"{counted(starting, 'worker')} starting")
        if self._waiting:
            cameras = [job.entry.id for job in self._waiting]
            lines.append(f"{counted(len(cameras), 'camera')} waiting ({listed(cameras)})")
        return ", ".join(lines)


def _started(work: Work) -> _Worker:
    """Return a worker that has just been started."""
    pipe, worker_pipe = _SPAWN.Pipe()
    process = _SPAWN.Process(target=_serve_cameras, args=(worker_pipe, work), daemon=True)
    with _worker_environment():
        process.start()
    worker_pipe.close()
    return _Worker(process, pipe)


@contextmanager
def _worker_environment() -> Iterator[None]:
    """Within, processes start with one thread for each library, and without Ctrl-C.

    A terminal sends Ctrl-C to all of them; this process ends the workers.
    """
    unset = [name for name in THREAD_LIMITS if name not in os.environ]
    os.environ.update(dict.fromkeys(unset, "1"))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for name in unset:
            del os.environ[name]


def _serve_cameras(pipe: Connection, work: Work) -> None:
    """Calibrate, in a worker, the cameras that come through the pipe, until it closes."""
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    with suppress(EOFError, ConnectionError):  # the command has ended
        pipe.send(_READY)
        while True:
            pipe.send(work(pipe.recv()))


def _exit_with_parent() -> None:
    """End this worker when the command has ended, however that ended."""
    parent = parent_process()
    assert parent
    parent.join()
    os._exit(1)


def _megabytes(count: int) -> str:
    return f"{count / (1 << 20):.0f} MB"

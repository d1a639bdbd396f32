"""The workers that run a large benchmark's sessions: processes of this machine, or on a Dask
cluster by the adapter of `calib batch`.

A cluster's workers need this checkout, at the same place: python -m benchmarks.diagnosis
--scheduler tls://head:8786
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from rich.progress import track

from calib.errors import RefracalError
from calib.fleet.cluster import QUEUES, Place, client_of, remarks_on

CHECKOUT = Path(__file__).parents[1]
T = TypeVar("T")


class Future(Protocol):
    """The common part of the futures of concurrent.futures and of Dask."""

    def result(self) -> Any: ...


class Submit(Protocol):
    def __call__(self, function: Callable[..., Any], /, *arguments: object) -> Future: ...


@dataclass(frozen=True, slots=True)
class Session(Generic[T]):
    """A session that a worker does."""

    future: Future
    workers: Workers

    def result(self) -> T:
        outcome: T
        outcome, seconds = self.future.result()
        self.workers.spent.append(seconds)
        return outcome


@dataclass(slots=True)
class Workers:
    """The workers that get the sessions, and their scaling."""

    submit_one: Submit
    count: Callable[[], int]
    start_time: float = field(default_factory=time.monotonic)
    spent: list[float] = field(default_factory=list)
    """s that each session took where it ran."""

    def submit(self, function: Callable[..., T], *arguments: object) -> Session[T]:
        """Args: function: of a module that workers can import, or of the one that was started."""
        return Session(self.submit_one(timed, importable(function), *arguments), self)

    def each(
        self, function: Callable[..., T], rows: Sequence[Sequence[object]], title: str
    ) -> Iterator[T]:
        """Results in the order of their arguments."""
        for item in track([self.submit(function, *row) for row in rows], title, transient=True):
            yield item.result()

    @property
    def scaled(self) -> str:
        wall, work, count = time.monotonic() - self.start_time, sum(self.spent), self.count()
        workers = f"{count} worker{'s' * (count != 1)}"
        longest = max(self.spent, default=0.0)
        return (
            f"{len(self.spent)} sessions in {wall:.0f} s on {workers}: {work:.0f} s of work,"
            f" {work / wall:.2f} times as fast as one after the other,"
            f" {100 * work / wall / max(1, count):.0f} % of the workers' time; the longest took"
            f" {longest:.0f} s."
        )


def add_workers(parser: argparse.ArgumentParser) -> None:
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--jobs",
        type=int,
        default=1,
        help="sessions at once, in processes of this machine (default: %(default)s)",
    )
    where.add_argument(
        "--scheduler",
        default="",
        metavar="ADDRESS",
        help="a Dask cluster that exists, such as tls://head:8786",
    )
    where.add_argument(
        "--jobqueue", default="", choices=[*QUEUES], help="send workers as jobs of this queue"
    )
    parser.add_argument("--workers", type=int, metavar="N", help="of the queue")


@contextmanager
def workers_of(options: argparse.Namespace) -> Iterator[Workers]:
    """Return the workers that the options name; end the program with a sentence if there is no such
    cluster.
    """
    if not (options.scheduler or options.jobqueue):
        with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
            yield Workers(pool.submit, lambda: options.jobs)
        return
    try:
        place = Place(options.scheduler, options.jobqueue, options.workers)
        with client_of(place, CHECKOUT) as client:
            for remark in remarks_on(place, client):
                print(remark, file=sys.stderr)

            def submit(function: Callable[..., Any], /, *arguments: object) -> Future:
                return client.submit(function, *arguments, pure=False)  # type: ignore[no-any-return]

            yield Workers(submit, lambda: len(client.scheduler_info(n_workers=-1)["workers"]))
    except RefracalError as error:
        sys.exit(str(error))


def importable(function: Callable[..., T]) -> Callable[..., T]:
    """The same function by its module's own name, where that was started as the program."""
    main = sys.modules["__main__"]
    if function.__module__ != "__main__" or not main.__spec__:
        return function
    function_found: Callable[..., T] = getattr(import_module(main.__spec__.name), function.__name__)
    return function_found


def timed(function: Callable[..., T], *arguments: object) -> tuple[T, float]:
    start_time = time.monotonic()
    return function(*arguments), time.monotonic() - start_time

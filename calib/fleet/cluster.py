"""Where a fleet's workers run: on this machine, at a scheduler that exists, or as jobs of a queue.

A worker does one camera at a time.
"""

from __future__ import annotations

import logging
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from shutil import which
from tempfile import gettempdir
from typing import TYPE_CHECKING, Any

from calib.errors import InputError, RefracalError, brief
from calib.extras import how_to_install
from calib.version import VERSION

if TYPE_CHECKING:
    from distributed import Client

NEEDED = f"calib batch runs on Dask, which is not installed: {how_to_install('fleet')}"
QUEUES = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "sge": "SGECluster",
    "lsf": "LSFCluster",
    "oar": "OARCluster",
    "moab": "MoabCluster",
    "htcondor": "HTCondorCluster",
}
"""Of dask-jobqueue."""
FIT_BYTES = 2 << 30
"""What one camera may need: 0.44 GB were measured for twenty views of corners, and pictures are
decoded one a thread.
"""
CONNECT_S = 30
"""How long a scheduler may take to answer."""
JOBS = 8
"""Workers of a queue, unless told otherwise."""
OWN_DEATHS = 20
"""Deaths of workers that a local cluster takes for somebody else's fault, before it gives a camera
up.
"""
SETTINGS = {
    "distributed.scheduler.allowed-failures": OWN_DEATHS,
    # A fit keeps nothing that could be spilled, and a worker that pauses would never go on: it ends
    # where it takes what others need.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    "distributed.worker.daemon": True,
    "distributed.worker.profile.enabled": (
        False
    ),  # it would stop the fit a hundred times a second to look at it
}


class FleetError(RefracalError):
    """The cluster is gone: what is done is kept, and the same command goes on from there."""

    exit_code = 6


@dataclass(frozen=True, slots=True)
class Place:
    """Where a person wants the work done."""

    scheduler: str = ""
    """Address of a cluster that exists; empty: one of its own."""
    jobqueue: str = ""
    """Of `QUEUES`; empty: on this machine."""
    workers: int | None = None
    memory: int | None = None
    """Bytes that each worker may take."""


@contextmanager
def client_of(place: Place, fleet: Path) -> Iterator[Client]:
    """A client of the cluster, which ends with it if it is our own.

    Raises:
        InputError: Dask is not installed, or there is no such scheduler or queue, or its workers do
            not see the fleet's folder.
    """
    try:
        import dask
        from distributed import Client
    except ImportError as error:
        raise InputError(NEEDED) from error
    for noisy in (
        "distributed",
        "tornado",
    ):  # deaths of workers are expected, and what they mean is told by the results
        logging.getLogger(noisy).setLevel(logging.CRITICAL)
    with dask.config.set(SETTINGS), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of ports in use, of other versions of Python
        if place.scheduler:
            try:
                client = Client(place.scheduler, timeout=CONNECT_S)
            except (OSError, ValueError, TimeoutError) as error:
                said = f"No scheduler answers at {brief(place.scheduler)} ({brief(error)})"
                raise InputError(
                    f"{said}: start one by 'dask scheduler', and give its address."
                ) from error
            with client:
                _check_workers(client, fleet)
                yield client
            return
        with (
            _queued(place) if place.jobqueue else _local(place) as cluster,
            Client(cluster) as client,
        ):
            yield client


def local_workers(place: Place) -> tuple[int, int]:
    """How many on this machine, and bytes for each: one a core, as far as the memory reaches."""
    from dask.system import CPU_COUNT
    from distributed.system import MEMORY_LIMIT

    workers = place.workers or max(1, min(CPU_COUNT, MEMORY_LIMIT // (place.memory or FIT_BYTES)))
    return workers, place.memory or MEMORY_LIMIT // workers


def _local(place: Place) -> Any:
    from distributed import LocalCluster

    workers, memory = local_workers(place)
    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        memory_limit=memory,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:8787",
        worker_dashboard_address=None,
        local_directory=gettempdir(),
        silence_logs=logging.CRITICAL,
    )


def _queued(place: Place) -> Any:
    """As many jobs as workers, and another for each that ends before the fleet is done."""
    try:
        import dask
        import dask_jobqueue
    except ImportError as error:
        raise InputError(NEEDED) from error
    kind = getattr(dask_jobqueue, QUEUES[place.jobqueue])
    if not which(kind.job_cls.submit_command.split()[0]):
        raise InputError(
            f"{kind.job_cls.submit_command} is not found, which sends jobs to {place.jobqueue}: run"
            " this on a machine of that cluster."
        )
    own = dask.config.get(f"jobqueue.{place.jobqueue}.job-script-prologue", None) or []
    told = [
        f"export DASK_{key.upper().replace('.', '__').replace('-', '_')}={value}"
        for key, value in SETTINGS.items()
    ]
    try:
        cluster = kind(
            cores=1,
            processes=1,
            memory=f"{(place.memory or 2 * FIT_BYTES) >> 20}MiB",
            job_script_prologue=[*own, *told],
        )
    except (OSError, ValueError, RuntimeError, TypeError) as error:
        raise InputError(
            f"No jobs can be made for {place.jobqueue} ({brief(error)}): correct queue, account and"
            " time in ~/.config/dask/jobqueue.yaml."
        ) from error
    workers = place.workers or JOBS
    cluster.adapt(minimum_jobs=workers, maximum_jobs=workers)
    return cluster


def _check_workers(client: Client, fleet: Path) -> None:
    """InputError where those that are there could not do the work."""
    try:
        seen = client.run(worker_state, str(fleet))
    except Exception as error:  # what a worker without refracal raises is of no one kind
        raise InputError(
            f"A worker of {client.scheduler.address} cannot run refracal ({brief(error)}): install"
            " it there."
        ) from error
    for address, (version, sees) in seen.items():
        if version != VERSION:
            raise InputError(
                f"The worker {address} has refracal {version} and this machine {VERSION}: install"
                " the same version on both."
            )
        if not sees:
            raise InputError(
                f"The worker {address} does not see {fleet}: give a folder with -o that all workers"
                " share."
            )


def worker_state(fleet: str) -> tuple[str, bool]:
    """The version there, and whether it sees a folder."""
    return VERSION, os.access(fleet, os.W_OK)

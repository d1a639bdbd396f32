"""A fleet's workers on Dask: at a scheduler that exists, or as jobs of a queue.

A worker calibrates one camera at a time.
"""

from __future__ import annotations

import logging
import os
import shlex
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from calib.errors import InputError, RefracalError, brief
from calib.extras import how_to_install
from calib.version import VERSION

if TYPE_CHECKING:
    from distributed import Client, Security

NEEDED = (
    "--scheduler and --jobqueue take Dask and cryptography, which are not all installed:"
    f" {how_to_install('fleet')}"
)
QUEUES = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "sge": "SGECluster",
    "lsf": "LSFCluster",
    "oar": "OARCluster",
    "moab": "MoabCluster",
    "htcondor": "HTCondorCluster",
}
"""Classes of dask-jobqueue."""
JOB_BYTES = 4 << 30
"""Memory of a queue's job, unless told otherwise: twice what one camera may need."""
CONNECT_S = 30
"""The longest wait for a scheduler's answer."""
JOBS = 8
"""Workers of a queue, unless told otherwise."""
SCHEDULER_PATIENCE_S = 600.0
"""The longest time that a scheduler of --scheduler may have no worker."""
QUEUE_PATIENCE_S = 86400.0
"""The longest time that a queue may run no job."""
KEYS_PREFIX = ".keys-"
"""The start of the name of a folder with the certificate of one run."""
ENCRYPTED = ("tls://", "wss://")
"""Schedulers that ask for a certificate."""
SETTINGS: dict[str, object] = {
    # A queue's jobs end with their time, so that the deaths of a camera's workers are not all its
    # fault.
    "distributed.scheduler.allowed-failures": 9,
    # A page of state or of a dashboard would be open to whoever reaches the port.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    # A fit keeps nothing that could be spilled, and a worker that pauses would never go on: it ends
    # where it takes what others need.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    # The profile would stop the fit a hundred times a second to look at it.
    "distributed.worker.profile.enabled": False,
}


class FleetError(RefracalError):
    """The cluster is gone. Results stay, and the same command goes on from there."""

    exit_code = 6


@dataclass(frozen=True, slots=True)
class Place:
    """The place where the workers run."""

    scheduler: str = ""
    """Address of a cluster that exists."""
    jobqueue: str = ""
    """A name of `QUEUES`. Without it and a scheduler, the workers run on this machine."""
    workers: int | None = None
    memory: int | None = None
    """Bytes that each worker may take."""

    @property
    def is_local(self) -> bool:
        """True if the workers run on this machine."""
        return not (self.scheduler or self.jobqueue)

    @property
    def patience_s(self) -> float:
        """Return the longest time that the fleet waits while no worker is connected."""
        return QUEUE_PATIENCE_S if self.jobqueue else SCHEDULER_PATIENCE_S


@contextmanager
def client_of(place: Place, fleet: Path) -> Iterator[Client]:
    """Yield a client of the cluster. Jobs of a queue end with it.

    Raises:
        InputError: Dask is not installed, or there is no such scheduler or queue, or its workers do
            not see the fleet's folder.
    """
    try:
        import dask
        from distributed import Client
    except ImportError as error:
        raise InputError(NEEDED) from error
    # Deaths of workers are expected, and the results tell of them.
    for noisy in ("distributed", "tornado"):
        logging.getLogger(noisy).setLevel(logging.CRITICAL)
    with dask.config.set(SETTINGS), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of ports in use, of other versions of Python
        if place.scheduler:
            with _connected(place.scheduler) as client:
                _check_workers(client, fleet)
                yield client
        else:
            with _queue(place, fleet) as cluster, Client(cluster) as client:
                yield client


def remarks_on(place: Place, client: Client) -> Iterator[str]:
    """Yield what a person should know of a scheduler that exists: who may use it, and that it has
    no worker.
    """
    if not place.scheduler:
        return
    if not client.scheduler.address.startswith(ENCRYPTED):
        yield (
            f"The scheduler {place.scheduler} asks for no certificate: whoever can connect to it"
            " can run programs on its workers, in the name of the person who started them. Start"
            " it and its workers with TLS (docs/fleet.md)."
        )
    if not client.nthreads():
        yield (
            "The cluster has no worker yet: start some by 'dask worker"
            f" {place.scheduler} --nthreads 1'."
        )


def _connected(address: str) -> Client:
    """Return a client of a scheduler that exists, with the certificates of Dask's configuration."""
    from distributed import Client

    try:
        return Client(address, timeout=CONNECT_S)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        advice = (
            "state the certificates in Dask's configuration (docs/fleet.md)"
            if address.startswith(ENCRYPTED)
            else "start one by 'dask scheduler', and give its address"
        )
        raise InputError(
            f"No scheduler answers at {brief(address)} ({brief(error)}): {advice}."
        ) from error


@contextmanager
def _queue(place: Place, fleet: Path) -> Iterator[Any]:
    """Yield a cluster with as many jobs as workers, and another for each that ends before the fleet
    is done.
    """
    try:
        import cryptography  # noqa: F401 - Dask makes certificates with it
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
    configured: dict[str, Any] = dask.config.get(f"jobqueue.{place.jobqueue}", None) or {}
    settings = [
        f"export DASK_{key.upper().replace('.', '__').replace('-', '_')}={shlex.quote(str(value))}"
        for key, value in SETTINGS.items()
    ]
    folder = os.path.expandvars(configured.get("shared-temp-directory") or fleet)
    with _security(Path(folder).expanduser()) as security:
        try:
            cluster = kind(
                cores=1,
                processes=1,
                memory=f"{(place.memory or JOB_BYTES) >> 20}MiB",
                job_script_prologue=[*(configured.get("job-script-prologue") or []), *settings],
                worker_extra_args=[*(configured.get("worker-extra-args") or []), "--no-dashboard"],
                scheduler_options={
                    "dashboard": False,
                    "dashboard_address": "127.0.0.1:0",
                    **(configured.get("scheduler-options") or {}),
                },
                security=security,
            )
        except (OSError, ValueError, RuntimeError, TypeError) as error:
            raise InputError(
                f"No jobs can be made for {place.jobqueue} ({brief(error)}): correct queue, account"
                " and time in ~/.config/dask/jobqueue.yaml."
            ) from error
        with cluster:
            workers = place.workers or JOBS
            cluster.adapt(minimum_jobs=workers, maximum_jobs=workers)
            yield cluster


@contextmanager
def _security(folder: Path) -> Iterator[Security]:
    """Yield the certificates of Dask's configuration. Without them, yield one that is made for this
    run, in a hidden folder that all jobs see, and that only this person can read.
    """
    from distributed import Security

    configured = Security()
    if configured.tls_ca_file:
        yield configured
        return
    made = Security.temporary()
    try:
        private = TemporaryDirectory(prefix=KEYS_PREFIX, dir=folder)
    except OSError as error:
        raise InputError(
            f"The keys of this run cannot be written to {folder} ({brief(error)}): name a folder"
            " that all jobs see as shared-temp-directory in ~/.config/dask/jobqueue.yaml."
        ) from error
    with private as name:
        certificate = Path(name) / "certificate.pem"
        key = Path(name) / "key.pem"
        certificate.write_text(made.tls_worker_cert)
        key.write_text(made.tls_worker_key)
        files: dict[str, str] = {}
        for role in ("client", "scheduler", "worker"):
            files[f"tls_{role}_cert"] = str(certificate)
            files[f"tls_{role}_key"] = str(key)
        yield Security(require_encryption=True, tls_ca_file=str(certificate), **files)


def _check_workers(client: Client, fleet: Path) -> None:
    """InputError if a connected worker cannot do the work."""
    try:
        states = client.run(worker_state, str(fleet))
    except Exception as error:  # a worker without refracal may raise anything
        raise InputError(
            f"A worker of {client.scheduler.address} cannot run refracal ({brief(error)}): install"
            " it there."
        ) from error
    for address, (version, sees) in states.items():
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
    """Return the version of refracal on a worker, and True if it may write to a folder."""
    return VERSION, os.access(fleet, os.W_OK)

"""A fleet on Dask, and the command: workers that die, a scheduler that goes away, jobs of a queue,
and a second command on the same folder.
"""

import json
import os
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import dask
import pytest
from distributed import Client, LocalCluster, Security

from calib.cli import main
from calib.fleet.cluster import FleetError, Place, client_of, remarks_on
from calib.fleet.job import Job
from calib.fleet.manifest import Entry
from calib.fleet.result import JobState, place_of, read_result
from calib.fleet.run import run_jobs
from calib.io.file_set import FileSet
from tests.fleet.conftest import ASKED, LINE
from tests.fleet.work import behave

OPTIONS = ("--grid", "3x3", "--free", "none", "--folds", "2")


@pytest.fixture
def client() -> Iterator[Client]:
    """Return a client whose workers are threads of this process: Dask itself, without its start of
    processes.
    """
    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def jobs(recorded: Path, fleet: Path) -> list[Job]:
    names = [*map(LINE.name, range(LINE.cameras)), "missing"]
    return [Job(Entry(name, str(recorded / name)), ASKED, str(fleet)) for name in names]


@pytest.mark.slow
@pytest.mark.usefixtures("without_figures")
def test_every_camera_has_its_result(client: Client, recorded: Path, tmp_path: Path) -> None:
    results = {result.id: result for result in run_jobs(client, jobs(recorded, tmp_path), print)}
    assert {name: result.state for name, result in results.items()} == {
        **dict.fromkeys(map(LINE.name, range(LINE.cameras)), JobState.CALIBRATED),
        "missing": JobState.FAILED,
    }
    assert all(read_result(tmp_path, name) == result for name, result in results.items())
    modified = place_of(tmp_path, LINE.name(0)).stat().st_mtime_ns
    assert {
        result.id: result for result in run_jobs(client, jobs(recorded, tmp_path), print)
    } == results
    assert place_of(tmp_path, LINE.name(0)).stat().st_mtime_ns == modified


@pytest.mark.slow
def test_a_camera_that_kills_its_workers_does_not_stop_the_others(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calib.fleet.run.run_job", behave)
    (tmp_path / "cameras").mkdir()
    kills = Job(Entry("kill", str(recorded / "kill")), ASKED, str(tmp_path))
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster,
        Client(cluster) as client,
    ):
        outcomes = run_jobs(client, [kills, *jobs(recorded, tmp_path)], print)
        results = {result.id: result for result in outcomes}
    assert len(results) == 6
    assert results["kill"].state is JobState.FAILED
    assert results["kill"].sentence == (
        "It was given up, because 2 workers of the cluster died of it: give workers more memory"
        " with --memory."
    )
    assert json.loads(place_of(tmp_path, "kill").read_text())["state"] == "failed"
    assert {results[name].state for name in results if name != "kill"} == {JobState.TOO_LITTLE}


def test_a_cluster_without_workers_says_so_and_ends(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calib.fleet.run.COUNT_S", 0.0)
    monkeypatch.setattr("calib.fleet.heartbeat.HEARTBEAT_S", 0.0)
    lines: list[str] = []
    with (
        LocalCluster(n_workers=0, processes=False, dashboard_address="127.0.0.1:0") as cluster,
        Client(cluster) as client,
        pytest.raises(FleetError, match=r"^No worker was connected for 0 min, and 5 of 5 cameras"),
    ):
        next(run_jobs(client, jobs(recorded, tmp_path), lines.append, patience_s=0.5))
    assert lines[0].startswith(
        "No camera has finished for 0 min: no worker connected, 5 cameras not done (cam"
    ), lines[0]


@contextmanager
def dask_process(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]],
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def free_port() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


@pytest.mark.slow
def test_a_scheduler_that_goes_away_ends_with_6_and_the_same_command_goes_on(
    recorded: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("calib.fleet.run.RETURN_S", 5.0)
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    start = ("dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    with (
        dask_process(*start) as scheduler,
        client_of(Place(address), tmp_path) as client,
    ):  # no worker comes
        outcomes = run_jobs(client, jobs(recorded, tmp_path), print)
        subprocess.Popen(
            [sys.executable, "-c", f"import os, time; time.sleep(3); os.kill({scheduler.pid}, 9)"]
        )
        with pytest.raises(
            FleetError, match=r"and 5 of 5 cameras are not done \(.*\): run the same command again"
        ) as caught:
            next(outcomes)
    assert caught.value.exit_code == 6
    with ExitStack() as stack:
        stack.enter_context(dask_process(*start))
        stack.enter_context(
            dask_process(
                "dask_worker",
                address,
                "--nthreads",
                "1",
                "--no-dashboard",
                "--local-directory",
                str(tmp_path),
            )
        )
        sessions = str(recorded / "*")
        assert (
            main(
                [
                    "batch",
                    sessions,
                    "-o",
                    str(tmp_path / "fleet"),
                    "--scheduler",
                    address,
                    *OPTIONS,
                    "--json",
                ]
            )
            == 0
        )
    printed = capsys.readouterr()
    assert f"The scheduler {address} asks for no certificate" in printed.err
    answer = json.loads(printed.out)
    assert answer["cameras"] == 4
    assert answer["states"] == {"calibrated": 4, "too_little_data": 0, "failed": 0}


@pytest.mark.slow
def test_the_command_is_killed_with_its_scheduler_and_goes_on(
    recorded: Path, tmp_path: Path
) -> None:
    command = [
        sys.executable,
        "-m",
        "calib",
        "batch",
        str(recorded / "*"),
        "-o",
        str(tmp_path / "fleet"),
        "--workers",
        "2",
        *OPTIONS,
    ]
    killed = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    place = tmp_path / "fleet" / "cameras"
    end = time.monotonic() + 240
    while not list(place.glob("*.json")) and time.monotonic() < end:
        time.sleep(0.05)
    killed.kill()
    killed.wait()
    done = {path.name: path.stat().st_mtime_ns for path in place.glob("*.json")}
    assert done
    second_run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert second_run.returncode == 0, second_run.stderr
    assert "Traceback" not in second_run.stderr
    assert sorted(path.name for path in place.glob("*.json")) == [
        f"{LINE.name(number)}.json" for number in range(4)
    ]
    assert {name: (place / name).stat().st_mtime_ns for name in done} == done
    assert (tmp_path / "fleet" / "fleet.html").exists()
    assert second_run.stdout.startswith("None of 4 cameras stands out.")


QUEUE = """#!/bin/sh
setsid sh -c "$(grep -v '^#' "$1")" > /dev/null 2>&1 &
echo "Submitted batch job $!"
"""
"""A script that does on this machine what `sbatch` does."""


@pytest.fixture
def queue(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Slurm's commands, which start jobs on this machine."""
    programs = tmp_path / "bin"
    programs.mkdir()
    for name, text in (("sbatch", QUEUE), ("scancel", '#!/bin/sh\nkill -- "-$1"\n')):
        (programs / name).write_text(text)
        (programs / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")


@pytest.mark.slow
@pytest.mark.usefixtures("queue")
def test_workers_run_as_jobs_of_a_queue(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--jobqueue", "slurm", "--workers", "1", *OPTIONS, "--json")
    assert main(["batch", str(recorded / "*"), "-o", str(tmp_path / "fleet"), *options]) == 0
    assert json.loads(capsys.readouterr().out)["states"]["calibrated"] == 4
    assert not list((tmp_path / "fleet").glob(".keys-*"))


def test_a_missing_queue_gets_a_sentence(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--jobqueue", "slurm", *OPTIONS)
    assert main(["batch", str(recorded / "*"), "-o", str(tmp_path / "fleet"), *options]) == 2
    assert "sbatch is not found, which sends jobs to slurm" in capsys.readouterr().err


def greeting(address: str, security: Security | None) -> bytes:
    """Return the first bytes that a Dask process sends to whoever has a certificate; empty if it
    closes the connection.
    """
    host, _, port = address.removeprefix("tls://").rpartition(":")
    with socket.create_connection((host, int(port)), timeout=600) as plain:
        if not security:
            plain.sendall(bytes(64))
            with suppress(ConnectionResetError):
                return plain.recv(8)
            return b""
        context = security.get_connection_args("client")["ssl_context"]
        context.verify_mode = ssl.CERT_NONE  # a stranger talks with anybody
        with suppress(ssl.SSLError, ConnectionResetError), context.wrap_socket(plain) as encrypted:
            return bytes(encrypted.recv(8))
        return b""


@pytest.mark.slow
@pytest.mark.usefixtures("queue")
def test_only_its_person_runs_code_in_the_jobs_of_a_queue(tmp_path: Path) -> None:
    """Scheduler and worker talk only to who has the run's key, which no other account can read, and
    their HTTP ports serve nothing.
    """
    place = Place(jobqueue="slurm", workers=1)
    with client_of(place, tmp_path) as client:
        process = client.submit(os.getpid)  # a worker that holds a result is not sent home
        assert process.result(timeout=600) != os.getpid()
        assert list(remarks_on(place, client)) == []
        (keys,) = tmp_path.glob(".keys-*")
        assert keys.stat().st_mode & 0o077 == 0
        scheduler = client.scheduler_info()
        ((worker, state),) = scheduler["workers"].items()
        for address in (client.scheduler.address, worker, state["nanny"]):
            assert greeting(address, client.security)
            assert greeting(address, Security.temporary()) == b""
            assert greeting(address, None) == b""
        host = worker.removeprefix("tls://").rpartition(":")[0]
        for name, port in {**scheduler["services"], **state["services"]}.items():
            assert name == "dashboard"
            for path in ("", "health", "status", "info/main/workers.html", "json/counts.json"):
                with pytest.raises(HTTPError, match=r"404"):
                    urlopen(f"http://{host}:{port}/{path}", timeout=600)
    assert not list(tmp_path.glob(".keys-*"))


def test_a_second_command_on_the_same_fleet_is_refused(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with FileSet(tmp_path / "fleet"):
        assert main(["batch", str(recorded / "*"), "-o", str(tmp_path / "fleet"), *OPTIONS]) == 2
    assert "Another calib writes to" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--scheduler", "tcp://127.0.0.1:1"), "No scheduler answers at tcp://127.0.0.1:1"),
        (("--format", "ros"), "--format ros holds for one depth"),
        (("--workers", "0"), "'0' is not a number of workers"),
        (
            ("--memory", "4"),
            "'4' is not a size of memory: write a number with its unit, such as 4GB",
        ),
        (("--memory", f"{'9' * 400}GB"), "is not a size of memory"),
        (("--workers", "9" * 5000), "is not a number of workers"),
        (("--jobqueue", "slurm", "--scheduler", "tcp://a:1"), "not allowed with argument"),
    ],
)
def test_wrong_options_get_a_sentence(
    recorded: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.setattr("calib.fleet.cluster.CONNECT_S", 1)
    try:
        code = main(["batch", str(recorded / "*"), "-o", str(tmp_path / "fleet"), *arguments])
    except SystemExit as exited:
        code = int(str(exited.code))
    assert code == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error


def test_a_run_without_dask_names_the_package_to_install(
    recorded: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    command = ["batch", str(recorded / "*"), "-o", str(tmp_path / "fleet")]
    assert main([*command, "--scheduler", "tcp://127.0.0.1:1"]) == 2
    assert "pip install 'cryptography>=42' 'dask-jobqueue>=0.9'" in capsys.readouterr().err

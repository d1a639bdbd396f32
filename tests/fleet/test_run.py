"""A fleet on Dask: workers that die, a scheduler that goes away, and a second command on the same
folder.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from distributed import Client, LocalCluster

from calib.cli import main
from calib.fleet.cluster import FleetError, Place, client_of, local_workers
from calib.fleet.job import Job
from calib.fleet.manifest import Entry
from calib.fleet.result import Result, State, place_of, read_result
from calib.fleet.run import run_jobs
from calib.io.file_set import FileSet
from tests.fleet.conftest import ASKED, LINE

OPTIONS = ("--grid", "3x3", "--free", "none", "--folds", "2")


@pytest.fixture
def client() -> Iterator[Client]:
    """Of workers that are threads of this process: Dask itself, without its start of processes."""
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


@pytest.mark.usefixtures("without_figures")
def test_every_camera_has_its_result(client: Client, recorded: Path, tmp_path: Path) -> None:
    results = {result.id: result for result in run_jobs(client, jobs(recorded, tmp_path))}
    assert {name: result.state for name, result in results.items()} == {
        **dict.fromkeys(map(LINE.name, range(LINE.cameras)), State.CALIBRATED),
        "missing": State.FAILED,
    }
    assert all(read_result(tmp_path, name) == result for name, result in results.items())
    before = place_of(tmp_path, LINE.name(0)).stat().st_mtime_ns
    assert {result.id: result for result in run_jobs(client, jobs(recorded, tmp_path))} == results
    assert place_of(tmp_path, LINE.name(0)).stat().st_mtime_ns == before


def _die(job: Job) -> Result:
    """A camera that takes all memory, or a worker that somebody kills."""
    if job.entry.id == "missing":
        os.kill(os.getpid(), signal.SIGKILL)
    return Result(job.entry.id, State.TOO_LITTLE)


@pytest.mark.slow
def test_a_camera_of_which_workers_die_does_not_stop_the_others(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calib.fleet.run.run_job", _die)
    monkeypatch.setattr(
        "calib.fleet.cluster.SETTINGS", {"distributed.scheduler.allowed-failures": 0}
    )
    with client_of(Place(workers=2), tmp_path) as client:
        (tmp_path / "cameras").mkdir()
        results = {result.id: result for result in run_jobs(client, jobs(recorded, tmp_path))}
    assert len(results) == 5
    assert results["missing"].state is State.FAILED
    assert (
        results["missing"].sentence
        == "Every worker that was given it died, 3 times over: give workers more memory with"
        " --memory."
    )
    assert json.loads(place_of(tmp_path, "missing").read_text())["state"] == "failed"


@contextmanager
def dask(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
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
        dask(*start) as scheduler,
        client_of(Place(address), tmp_path) as client,
    ):  # no worker comes
        found = run_jobs(client, jobs(recorded, tmp_path))
        subprocess.Popen(
            [sys.executable, "-c", f"import os, time; time.sleep(3); os.kill({scheduler.pid}, 9)"]
        )
        with pytest.raises(
            FleetError, match=r"with 5 of 5 cameras left: run the same command again"
        ) as caught:
            next(found)
    assert caught.value.exit_code == 6
    with ExitStack() as stack:
        stack.enter_context(dask(*start))
        stack.enter_context(
            dask(
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
    said = json.loads(capsys.readouterr().out)
    assert said["cameras"] == 4
    assert said["states"] == {"calibrated": 4, "too_little_data": 0, "failed": 0}


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
    after = subprocess.run(command, capture_output=True, text=True, check=False)
    assert after.returncode == 0, after.stderr
    assert "Traceback" not in after.stderr
    assert sorted(path.name for path in place.glob("*.json")) == [
        f"{LINE.name(number)}.json" for number in range(4)
    ]
    assert {name: (place / name).stat().st_mtime_ns for name in done} == done
    assert (tmp_path / "fleet" / "fleet.html").exists()
    assert after.stdout.startswith("None of 4 cameras stands out.")


QUEUE = """#!/bin/sh
setsid sh -c "$(grep -v '^#' "$1")" > /dev/null 2>&1 &
echo "Submitted batch job $!"
"""
"""What `sbatch` does, on this machine."""


@pytest.mark.slow
def test_jobs_of_a_queue(
    recorded: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    programs = tmp_path / "bin"
    programs.mkdir()
    for name, text in (("sbatch", QUEUE), ("scancel", '#!/bin/sh\nkill -- "-$1"\n')):
        (programs / name).write_text(text)
        (programs / name).chmod(0o755)
    arguments = [
        "batch",
        str(recorded / "*"),
        "-o",
        str(tmp_path / "fleet"),
        "--jobqueue",
        "slurm",
        "--workers",
        "1",
        *OPTIONS,
        "--json",
    ]
    assert main(arguments) == 2
    assert "sbatch is not found, which sends jobs to slurm" in capsys.readouterr().err
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    assert main(arguments) == 0
    assert json.loads(capsys.readouterr().out)["states"]["calibrated"] == 4


def test_a_second_command_on_the_same_fleet_is_refused(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with FileSet(tmp_path / "fleet"):
        assert main(["batch", str(recorded / "*"), "-o", str(tmp_path / "fleet"), *OPTIONS]) == 2
    assert "Another calib writes to" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
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
def test_what_is_wrong_on_the_command_line(
    recorded: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    said: str,
) -> None:
    monkeypatch.setattr("calib.fleet.cluster.CONNECT_S", 1)
    try:
        code = main(["batch", str(recorded / "*"), "-o", str(tmp_path / "fleet"), *arguments])
    except SystemExit as exited:
        code = int(str(exited.code))
    assert code == 2
    error = capsys.readouterr().err
    assert said in error
    assert "Traceback" not in error


def test_without_dask_it_says_what_to_install(
    recorded: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["batch", str(recorded / "*"), "-o", str(tmp_path / "fleet")]) == 2
    assert "pip install 'bokeh>=3.1' 'dask-jobqueue>=0.9'" in capsys.readouterr().err


def test_workers_are_one_a_core_as_far_as_the_memory_reaches(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("dask.system.CPU_COUNT", 8)
    monkeypatch.setattr("distributed.system.MEMORY_LIMIT", 5 << 30)
    assert local_workers(Place()) == (2, 5 << 29)
    assert local_workers(Place(workers=5)) == (5, 1 << 30)
    assert local_workers(Place(memory=1 << 30)) == (5, 1 << 30)

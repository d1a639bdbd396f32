"""A fleet's workers on this machine: nobody can connect to them, and what dies is replaced or given
up.
"""

import os
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import psutil
import pytest

from calib.fleet import local
from calib.fleet.cluster import FleetError, Place
from calib.fleet.job import Job
from calib.fleet.local import local_workers, run_locally
from calib.fleet.manifest import Entry
from calib.fleet.result import JobState, place_of
from tests.fleet.conftest import ASKED
from tests.fleet.work import behave

GIB = 1 << 30


def jobs(names: Sequence[str], fleet: Path) -> list[Job]:
    (fleet / "cameras").mkdir(exist_ok=True)
    return [Job(Entry(name, str(fleet / name)), ASKED, str(fleet)) for name in names]


def listeners() -> list[str]:
    """Return the ports on which this process and its children listen."""
    processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
    return [
        str(connection.laddr)
        for process in processes
        for connection in process.net_connections()
        if connection.status == psutil.CONN_LISTEN
    ]


def test_every_camera_has_its_result_and_nothing_listens(tmp_path: Path) -> None:
    sockets = listeners()
    lines: list[str] = []
    results = run_locally(jobs("abc", tmp_path), Place(workers=1), lines.append, behave)
    first = next(results)
    assert listeners() == sockets
    (worker,) = local_children()
    assert first.sentence == os.environ.get("OMP_NUM_THREADS", "1")
    assert [first.id, *(result.id for result in results)] == ["a", "b", "c"]
    assert not worker.is_running()
    assert lines == []


def local_children() -> list[psutil.Process]:
    return [
        child
        for child in psutil.Process().children()
        if any("spawn_main" in word for word in child.cmdline())
    ]


@pytest.mark.slow
def test_a_camera_that_kills_its_workers_is_given_up_and_the_others_continue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local, "KILLED_ATTEMPTS", 2)
    lines: list[str] = []
    place = Place(workers=1, memory=GIB)
    names = ("crash", "kill", "memory", "sound")
    results = {r.id: r for r in run_locally(jobs(names, tmp_path), place, lines.append, behave)}
    assert results["sound"].state is JobState.TOO_LITTLE
    assert results["crash"].sentence == (
        "3 workers died while they calibrated it, and it was given up: the last one ended with exit"
        " code 7."
    )
    assert results["kill"].sentence.startswith(
        "2 workers died while they calibrated it, and it was given up: the last one was killed by"
        " signal 9"
    )
    assert "MB, and may take 1024 MB. Give workers more memory" in results["memory"].sentence
    assert all(results[name].state is JobState.FAILED for name in names[:3])
    assert all(place_of(tmp_path, name).exists() for name in names[:3])
    assert lines[0] == (
        "A worker died while it calibrated crash: it ended with exit code 7. The camera is tried"
        " again (2 of 3)."
    )


def test_a_run_without_workers_names_the_cause_and_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local, "START_ATTEMPTS", 2)
    lines: list[str] = []
    place = Place(workers=1, memory=1 << 20)
    with pytest.raises(FleetError, match=r"^No worker can start: 2 in a row died") as caught:
        next(run_locally(jobs("ab", tmp_path), place, lines.append, behave))
    assert "and may take 1 MB. 2 of 2 cameras are not done (a, b)." in str(caught.value)
    assert caught.value.exit_code == 6
    assert len(lines) == 2
    assert local_children() == []


@pytest.mark.slow
def test_a_worker_that_dies_while_it_starts_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = local._started
    victims = iter([True])

    def started(work: local.Work) -> local._Worker:
        worker = start(work)
        if next(victims, False):
            worker.process.kill()
        return worker

    monkeypatch.setattr(local, "_started", started)
    lines: list[str] = []
    results = list(run_locally(jobs("a", tmp_path), Place(workers=1), lines.append, behave))
    assert [result.state for result in results] == [JobState.TOO_LITTLE]
    assert lines == [
        "A worker died while it started: it was killed by signal 9, as the system does when memory"
        " runs out (1 of 5 in a row)."
    ]


def test_a_run_names_what_it_waits_for_and_its_end_ends_the_workers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calib.fleet.heartbeat.HEARTBEAT_S", 0.0)
    lines: list[str] = []
    names = ("a", "memory", *"bcdefg")
    with closing(
        run_locally(jobs(names, tmp_path), Place(workers=1, memory=4 * GIB), lines.append, behave)
    ) as results:
        assert next(results).id == "a"
        assert len(local_children()) == 1
    assert local_children() == []
    start = "No camera has finished for 0 min: 1 worker"
    assert lines[0] == f"{start} starting, 8 cameras waiting (a, memory, b, c, d and 3 more)."
    assert f"{start} at a, 7 cameras waiting (memory, b, c, d, e and 2 more)." in lines


def test_one_worker_per_core_is_started_within_the_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(local, "core_count", lambda: 8)
    monkeypatch.setattr(local, "memory_bytes", lambda: 5 * GIB)
    assert local_workers(Place()) == (2, 5 * GIB // 2)
    assert local_workers(Place(workers=5)) == (5, GIB)
    assert local_workers(Place(memory=GIB)) == (5, GIB)

"""The cores and memory of this machine, within the limits of control groups of both versions."""

import mmap
import os
from pathlib import Path

import pytest

from calib.fleet import machine
from calib.fleet.machine import core_count, memory_bytes, resident_bytes

PHYSICAL = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


@pytest.fixture
def groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder of control groups, and eight cores."""
    monkeypatch.setattr(machine, "CGROUPS", tmp_path / "cgroup")
    monkeypatch.setattr(machine, "PROCESSES", tmp_path / "proc")
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)))
    return tmp_path / "cgroup"


def write(file: Path, text: str) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)


def test_a_process_without_limits_has_the_whole_machine(groups: Path) -> None:
    assert core_count() == 8
    assert memory_bytes() == PHYSICAL
    write(groups.parent / "proc" / "self" / "cgroup", "0::/user/session\n")
    write(groups / "user" / "session" / "cpu.max", "max 100000\n")
    write(groups / "user" / "session" / "memory.max", "max\n")
    assert core_count() == 8
    assert memory_bytes() == PHYSICAL


def test_the_lowest_limit_of_the_enclosing_groups_counts(groups: Path) -> None:
    write(groups.parent / "proc" / "self" / "cgroup", "1:cpu:/else\n0::/user/session\n")
    write(groups / "user" / "session" / "cpu.max", "450000 100000\n")
    write(groups / "user" / "cpu.max", "250000 100000\n")
    write(groups / "user" / "memory.max", "1048576\n")
    assert core_count() == 3
    assert memory_bytes() == 1 << 20


def test_groups_of_the_first_version(groups: Path) -> None:
    write(groups / "cpu" / "cpu.cfs_quota_us", "200000\n")
    write(groups / "cpu" / "cpu.cfs_period_us", "100000\n")
    write(groups / "memory" / "memory.limit_in_bytes", "2097152\n")
    assert core_count() == 2
    assert memory_bytes() == 2 << 20
    write(groups / "cpu" / "cpu.cfs_quota_us", "-1\n")
    assert core_count() == 8


def test_the_memory_of_a_process() -> None:
    with mmap.mmap(-1, 64 << 20) as taken:  # a new array may lie where an old one was
        initial = resident_bytes(os.getpid())
        for start in range(0, len(taken), mmap.PAGESIZE):
            taken[start] = 1
        final = resident_bytes(os.getpid())
    assert final - initial > 60 << 20
    assert resident_bytes(2**22 + 1) == 0

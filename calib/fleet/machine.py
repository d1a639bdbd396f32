"""The cores and the memory that a fleet may use on this machine, and the memory that a process
takes.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path

CGROUPS = Path("/sys/fs/cgroup")
"""The folder in which Linux states a container's limits."""
PROCESSES = Path("/proc")


def core_count() -> int:
    """Return the number of cores that this process may use, at most its container's quota."""
    if hasattr(os, "sched_getaffinity"):
        count = len(os.sched_getaffinity(0))
    else:
        count = os.cpu_count() or 1
    old_quota = _numbers(CGROUPS / "cpu" / "cpu.cfs_quota_us")
    old_period = _numbers(CGROUPS / "cpu" / "cpu.cfs_period_us")
    quotas = [_numbers(group / "cpu.max") for group in _groups()]
    for quota in (*quotas, old_quota + old_period):
        if len(quota) == 2 and min(quota) > 0:
            count = min(count, math.ceil(quota[0] / quota[1]))
    return count


def memory_bytes() -> int:
    """Return the memory of this machine, at most its container's limit."""
    total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    files = [group / "memory.max" for group in _groups()]
    files.append(CGROUPS / "memory" / "memory.limit_in_bytes")
    limits = [number for file in files for number in _numbers(file) if number > 0]
    return min([total, *limits])


def resident_bytes(process_id: int) -> int:
    """Return the memory that a process takes; 0 if it has ended, or on a system without /proc."""
    pages = _numbers(PROCESSES / str(process_id) / "statm")
    return pages[1] * os.sysconf("SC_PAGE_SIZE") if pages else 0


def _groups() -> Iterator[Path]:
    """Yield this process's control group and the groups around it, each of which may set limits."""
    try:
        lines = (PROCESSES / "self" / "cgroup").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.removeprefix("0::/") for line in lines if line.startswith("0::/")]
    for name in names:
        group = CGROUPS / name
        yield group
        yield from (parent for parent in group.parents if parent.is_relative_to(CGROUPS))


def _numbers(file: Path) -> list[int]:
    """Return a file's whole numbers; empty if there is no such file, or it states no limit."""
    try:
        return [int(word) for word in file.read_text().split()]
    except (OSError, ValueError):
        return []

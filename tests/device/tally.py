"""The tally of the checks on devices that ran and that did not: a group that silently ran nothing
must not look like one that passed.
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import PurePath

import pytest

from tests.device.skipped import SKIPPED


class Tally:
    """A plug-in of pytest that counts the checks of each group, by their file check_NAME.py."""

    def __init__(self, groups: Sequence[str]) -> None:
        self.groups = groups
        self.missing: dict[str, str] = {}
        """Groups that this machine cannot run, with what it lacks."""
        self.ran: Counter[str] = Counter()
        self.skipped: Counter[str] = Counter()
        self.failed: Counter[str] = Counter()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        group = PurePath(report.location[0]).stem.removeprefix("check_")
        self.ran[group] += report.when == "call" and not report.skipped
        self.failed[group] += report.failed
        self.skipped[group] += report.skipped

    @property
    def code(self) -> int:
        """The exit code."""
        if any(self.failed.values()) or any(
            not self.ran[group] for group in self.groups if group not in self.missing
        ):
            return 1
        return SKIPPED if self.missing else 0

    def __str__(self) -> str:
        """A line for each group."""
        return "\n".join(f"Device checks, {group}: {self._line(group)}" for group in self.groups)

    def _line(self, group: str) -> str:
        if group in self.missing:
            return f"SKIPPED: {self.missing[group]}"
        counts = (
            f"{self.ran[group]} ran, {self.failed[group]} failed, {self.skipped[group]} skipped"
        )
        return (
            counts
            if self.ran[group]
            else f"{counts}; FAILED, as this machine has all that they need"
        )

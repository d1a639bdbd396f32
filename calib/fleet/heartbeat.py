"""A line for the person who waits, where no camera of a fleet finishes for a minute."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

HEARTBEAT_S = 60.0
MAX_NAMES = 5
"""Cameras that a line names."""


class Heartbeat:
    """Speaks once a minute, until a camera finishes."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._finished_at = time.monotonic()
        self._spoke_at = self._finished_at

    def finish(self) -> None:
        """Start the minute again, for a camera has finished."""
        self._finished_at = time.monotonic()
        self._spoke_at = self._finished_at

    def speak(self, describe: Callable[[], str]) -> None:
        """Say what the fleet waits for, if nothing was said and no camera finished for a minute."""
        time_s = time.monotonic()
        if time_s - self._spoke_at >= HEARTBEAT_S:
            self._spoke_at = time_s
            seconds = time_s - self._finished_at
            self._say(f"No camera has finished for {seconds / 60:.0f} min: {describe()}.")


def listed(names: Sequence[str]) -> str:
    """Return the first names of a list, and how many more there are."""
    remainder = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return ", ".join(names[:MAX_NAMES]) + remainder

"""The state of the camera that a calibration is true for, and what changed in it within a
session.
"""

import math
from collections.abc import Mapping

KEYS = ("exposure_us", "gain", "lens_position", "focus", "crop")
"""As the columns of frames.csv are called."""
ROUNDING = 0.01
"""Of a value: cameras round what they were asked for."""


class State:
    """Follows the rows of frames.csv in their order."""

    def __init__(self) -> None:
        self._last: dict[str, str] = {}
        self._said: set[str] = set()

    def changes(self, row: Mapping[str, str]) -> list[str]:
        """What is other than in the rows before, a sentence each; of each key only the first
        time.
        """
        sentences = []
        for key in KEYS:
            now = row.get(key, "")
            before = self._last.get(key, now)
            if now and key not in self._said and not _same(before, now):
                self._said.add(key)
                sentences.append(
                    f"{key} changed within the session, from {before} to {now} at {row['file']}: a"
                    " calibration is true for one state of the camera, so lock it and record these"
                    " pictures again."
                )
            if now:
                self._last[key] = now
        return sentences


def _same(before: str, now: str) -> bool:
    try:
        return math.isclose(float(before), float(now), rel_tol=ROUNDING, abs_tol=1e-3)
    except ValueError:
        return before == now

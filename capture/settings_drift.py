"""The camera settings for which a calibration is valid, and the changes within a session."""

import math
from collections.abc import Mapping

KEYS = ("exposure_us", "gain", "lens_position", "focus", "crop")
"""The settings, as frames.csv names its columns."""
ROUNDING = 0.01
"""The relative tolerance: cameras round the requested values."""


class SettingsDrift:
    """Follows the settings through the rows of frames.csv, in their order."""

    def __init__(self) -> None:
        self._last: dict[str, str] = {}
        self._reported: set[str] = set()

    def find_changes(self, row: Mapping[str, str]) -> list[str]:
        """Return a sentence for every setting that differs from the rows before. Each setting is
        reported once.
        """
        sentences = []
        for key in KEYS:
            value = row.get(key, "")
            previous = self._last.get(key, value)
            if value and key not in self._reported and not _same(previous, value):
                self._reported.add(key)
                sentences.append(
                    f"{key} changed within the session, from {previous} to {value} at"
                    f" {row['file']}: a calibration is true for one state of the camera, so lock it"
                    " and record these pictures again."
                )
            if value:
                self._last[key] = value
        return sentences


def _same(previous: str, value: str) -> bool:
    try:
        return math.isclose(float(previous), float(value), rel_tol=ROUNDING, abs_tol=1e-3)
    except ValueError:
        return previous == value

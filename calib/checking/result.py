"""The result of a check, as data."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from calib.checking.significance import ALPHA
from calib.corners.view import RejectedPicture
from calib.rounding import with_sigma


class CheckStatus(Enum):
    """Statuses of a checked calibration, from good to bad."""

    VALID = "valid"
    UNDECIDED = "undecided"
    """The pictures of a rig contradict each other, so they show no change."""
    DEGRADED = "degraded"
    BROKEN = "broken"

    @property
    def sentence(self) -> str:
        return {
            CheckStatus.VALID: "The calibration is valid.",
            CheckStatus.UNDECIDED: "The pictures do not show whether the calibration is valid.",
            CheckStatus.DEGRADED: "The calibration is degraded.",
            CheckStatus.BROKEN: "The calibration is broken for these pictures.",
        }[self]


@dataclass(frozen=True, slots=True)
class Change:
    """A possible change of the camera, its cover, the board or the pictures."""

    name: str
    """The name of the effect, or other_mode, turned_pictures, no_cover, other_camera,
    other_board, unknown.
    """
    words: str
    """The start of the sentence, up to the size; without a capital."""
    probability: float
    """The probability among all changes that the check considers, and an unknown one."""
    value: float | None = None
    sigma: float | None = None
    unit: str = ""
    parameters: tuple[tuple[str, float, float, str], ...] = ()
    """Name, value, standard deviation and unit of each parameter."""

    def __str__(self) -> str:
        if self.value is None or self.sigma is None:
            return self.words
        return f"{self.words} {with_sigma(self.value, self.sigma)} {self.unit}".rstrip()

    def as_json(self) -> dict[str, object]:
        return {
            "name": self.name,
            "sentence": str(self),
            "probability": self.probability,
            "value": self.value,
            "sigma": self.sigma,
            "unit": self.unit,
            "parameters": {
                name: {"value": value, "sigma": sigma, "unit": unit}
                for name, value, sigma, unit in self.parameters
            },
        }


@dataclass(frozen=True, slots=True)
class CheckStatistics:
    """The test of a calibration on views, and the errors in px."""

    p_value: float
    statistic: float
    freedom: int
    """Degrees of freedom."""
    error_px: float
    """The root mean square two-dimensional error, with each view's pose refitted."""
    expected_px: float
    """The mean error of a valid calibration."""
    allowed_px: float
    """The largest error of a valid calibration, except for the false alarms."""
    added_px: float
    """The error that the most probable change adds, or else all error above the expected one."""
    noise_px: float
    """The noise of the corners in these pictures."""
    noise_ratio: float
    """The noise over that of the calibration's own corners, at least 1."""
    views: int
    reused_views: int = 0
    """Views that the calibration was fitted to, which cannot contradict it."""

    @property
    def typical_px(self) -> float:
        """The error of a typical view, px. The test compares it with `allowed_px`, so that single
        views with large errors raise no alarm.
        """
        return float(self.expected_px * self.statistic**0.5)

    def as_json(self) -> dict[str, object]:
        return {
            "statistic": self.statistic,
            "degrees_of_freedom": self.freedom,
            "p_value": self.p_value,
            "error_px": self.error_px,
            "expected_px": self.expected_px,
            "allowed_px": self.allowed_px,
            "added_px": self.added_px,
            "noise_px": self.noise_px,
            "views": self.views,
            "views_known": self.reused_views,
        }


NO_STATISTICS = dict.fromkeys(
    (
        "statistic",
        "p_value",
        "error_px",
        "expected_px",
        "allowed_px",
        "added_px",
        "noise_px",
    )
) | {"degrees_of_freedom": 0, "views": 0, "views_known": 0}
"""The JSON of pictures that cannot be tested, such as those of another mode."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The status of a calibration, and the changes that explain it."""

    status: CheckStatus
    statistics: CheckStatistics | None
    """None where the pictures cannot be of the calibrated camera: nothing was tested."""
    changes: tuple[Change, ...]
    """The most probable first; one of more than `NAME_ALONE` stands alone."""
    rejected: tuple[RejectedPicture, ...]
    lacking: str = ""
    """The name of the most probable change if the calibration's own views show it too: then the
    model lacks the effect, and nothing has changed.
    """
    note: str = ""
    """A remark on the board or the calibration of a valid check, without a capital and a full stop.
    """

    @property
    def sentence(self) -> str:
        """The status in words."""
        if self.statistics is None:
            return "These pictures cannot be compared with those of the calibration."
        if self.status is not CheckStatus.VALID or not self.is_known:
            return self.status.sentence
        if not self.has_new_views:
            return "Not checked: the calibration was made from these pictures."
        assert self.statistics
        pictures = f"{self.statistics.reused_views} of these {self.statistics.views} pictures"
        return f"Hardly checked: the calibration was made from {pictures}."

    @property
    def is_known(self) -> bool:
        """True if more than half of the tested views are those that the calibration was fitted
        to, which cannot contradict it.
        """
        return self.statistics is not None and (
            2 * self.statistics.reused_views > self.statistics.views
        )

    @property
    def has_new_views(self) -> bool:
        """True if a view was tested that the calibration was not fitted to."""
        return self.statistics is not None and (
            self.statistics.views > self.statistics.reused_views
        )

    def as_json(self) -> dict[str, object]:
        is_proof = self.status is not CheckStatus.VALID or not self.is_known
        reservation = "" if is_proof else f"{self.sentence[0].lower()}{self.sentence[1:-1]}"
        statistics = self.statistics.as_json() if self.statistics else NO_STATISTICS
        return (
            {"answer": self.status.value}
            | statistics
            | {
                "false_alarm_rate": ALPHA,
                "frames_rejected": [
                    {"file": rejected.name, "reason": rejected.reason} for rejected in self.rejected
                ],
                "changes": [change.as_json() for change in self.changes],
                "lacking": self.lacking,
                "note": self.note or reservation,
            }
        )

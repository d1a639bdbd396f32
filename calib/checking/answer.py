"""What a check answers, as data."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from calib.checking.significance import ALPHA
from calib.corners.view import RejectedPicture
from calib.fitting.rounding import with_sigma


class Word(Enum):
    """From good to bad."""

    VALID = "valid"
    DEGRADED = "degraded"
    BROKEN = "broken"

    @property
    def sentence(self) -> str:
        return {
            Word.VALID: "The calibration is valid.",
            Word.DEGRADED: "The calibration is degraded.",
            Word.BROKEN: "The calibration is broken for these pictures.",
        }[self]


@dataclass(frozen=True, slots=True)
class Change:
    """One thing that may have changed."""

    name: str
    """Of the effect, or other_mode, turned_pictures, no_cover, other_board, unknown."""
    words: str
    """The sentence, up to its size; without a capital."""
    probability: float
    """Among all that is known here, and what is not."""
    value: float | None = None
    sigma: float | None = None
    unit: str = ""
    parameters: tuple[tuple[str, float, float, str], ...] = ()
    """Each of its numbers: name, value, standard deviation, unit."""

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
class Answer:
    """Whether a calibration still holds."""

    word: Word
    p_value: float
    """Of the test; NaN where none was needed."""
    statistic: float
    freedom: int
    error_px: float
    """Root mean square two-dimensional error, each view's pose refitted."""
    expected_px: float
    """Of a valid calibration, on average."""
    allowed_px: float
    """The largest of a valid calibration, but for the false alarms."""
    added_px: float
    """What the change adds to the error: of the most probable one, or of all that is above what is
    expected.
    """
    noise_px: float
    """The corners' noise in these pictures."""
    louder: float
    """That over the noise of the calibration's own corners, at least 1."""
    views: int
    changes: tuple[Change, ...]
    """The most probable first; one of more than `families.ALONE` stands alone."""
    rejected: tuple[RejectedPicture, ...]
    lacking: str = ""
    """The name of the most probable change, where the calibration's own views show it too: it is no
    change, but what the model lacks.
    """

    known: int = 0
    """Views that the calibration was made from: of them it holds anyway."""

    def as_json(self) -> dict[str, object]:
        return {
            "answer": self.word.value,
            "statistic": self.statistic,
            "degrees_of_freedom": self.freedom,
            "p_value": self.p_value,
            "false_alarm_rate": ALPHA,
            "error_px": self.error_px,
            "expected_px": self.expected_px,
            "allowed_px": self.allowed_px,
            "added_px": self.added_px,
            "noise_px": self.noise_px,
            "views": self.views,
            "views_known": self.known,
            "frames_rejected": [{"file": one.name, "reason": one.reason} for one in self.rejected],
            "changes": [change.as_json() for change in self.changes],
            "lacking": self.lacking,
        }

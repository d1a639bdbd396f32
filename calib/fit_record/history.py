"""The history of a calibration since its fit: another medium, updates by checks, and diagnoses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class MediumChange:
    """The replacement of the medium outside of the cover."""

    from_index: float
    to_index: float
    sigma: float
    """The standard deviation of `to_index`."""
    calibration: str
    """The digest of the calibration in the original medium."""


@dataclass(frozen=True, slots=True)
class UpdateRecord:
    """An update of the calibration by the views of a check."""

    calibration_sha256: str
    """The digest of the calibration before the update."""
    finished: str
    """The time in UTC, as ISO 8601."""
    answer: str
    """The answer of the check, a `CheckStatus`."""
    views: tuple[str, ...]
    change: str
    """The name of the change that was fitted; empty if nothing has changed."""
    moved_sigmas: Mapping[str, float]
    """The shift of each number, in standard deviations before the update."""


@dataclass(frozen=True, slots=True)
class DiagnosisRun:
    """A diagnosis that led to the calibration."""

    calibration: str
    """The folder of the diagnosed calibration."""
    holdout: str
    """The session of the held-out views; empty if the folds were held out."""


@dataclass(frozen=True, slots=True)
class EffectEstimate:
    """The estimate of a parameter of an effect."""

    value: float
    sigma: float
    unit: str


@dataclass(frozen=True, slots=True)
class AcceptedEffect:
    """An effect that a diagnosis accepted."""

    name: str
    held_out_px_before: float
    """The held-out error without the effect."""
    held_out_px_after: float
    parameters: Mapping[str, EffectEstimate]
    varies: str | None = None
    """The way in which its numbers differ from view to view, in a word of the command contract;
    None if they do not.
    """
    spread: Mapping[str, EffectEstimate] = field(default_factory=dict)
    """The root mean square over the views of numbers that differ."""
    from_file: str | None = None
    """The first picture after a change at one view."""


@dataclass(frozen=True, slots=True)
class Family:
    """Effects of which one is present; these views do not tell which."""

    name: str
    """The common subject in plain words."""
    members: Mapping[str, float]
    """The probabilities of the members, the most probable first."""
    experiment: str
    """The advice that would decide between them."""

    @property
    def _chances(self) -> list[str]:
        return [f"{name} ({100 * chance:.0f} %)" for name, chance in self.members.items()]

    @property
    def note(self) -> str:
        """A short sentence that names the members."""
        likely, *rivals = self._chances
        return f"{likely} is the most likely cause; it may be {' or '.join(rivals)} as well."

    def __str__(self) -> str:
        likely, *rivals = self._chances
        return (
            f"The diagnosis found {self.name}: most likely {likely}, else {' or '.join(rivals)}."
            f" {self.experiment}"
        )


@dataclass(frozen=True, slots=True)
class Quality:
    """The errors of a model, root mean square."""

    rms_px: float
    rmse_cm: float
    held_out_px: float


def fit_names(*, had_effects: bool) -> tuple[str, str]:
    """Return the names of the two fits that a diagnosis compares: where it starts, and its result.

    Args:
        had_effects: True if the calibration had effects of an earlier diagnosis. Else the diagnosis
            starts from a plain fit, which has a flat board and no effect.
    """
    return "earlier effects" if had_effects else "plain fit", "with effects"


@dataclass(frozen=True, slots=True)
class DiagnosisRecord:
    """The last diagnosis."""

    document: Mapping[str, Any] = field(default_factory=dict)
    """The JSON object that `calib diagnose` printed; it is kept as evidence."""

    @property
    def accepted(self) -> tuple[AcceptedEffect, ...]:
        """The accepted effects."""
        return tuple(
            AcceptedEffect(
                name=candidate["effect"],
                held_out_px_before=candidate["held_out_px_before"],
                held_out_px_after=candidate["held_out_px_after"],
                parameters=_estimates(candidate["parameters"]),
                varies=candidate.get("varies"),
                spread=_estimates(candidate.get("spread", {})),
                from_file=candidate.get("from_file"),
            )
            for candidate in self.document.get("candidates", ())
            if candidate["accepted"]
        )

    @property
    def had_effects(self) -> bool:
        """True if the diagnosed calibration had effects already."""
        return bool(self.document.get("earlier"))

    @property
    def decided(self) -> bool:
        """False if there were too few views to confirm any effect."""
        return bool(self.document.get("decided", True))

    @property
    def families(self) -> tuple[Family, ...]:
        """The families of accepted effects."""
        return tuple(Family(**family) for family in self.document.get("families", ()))

    @property
    def qualities(self) -> tuple[Quality, ...]:
        """The errors before the effects were added, and after; none in records without them."""
        return tuple(
            Quality(errors["rms_px"], errors["rmse_cm"], errors["held_out_px"])
            for time in ("before", "after")
            if (errors := self.document.get(time))
        )


def _estimates(entries: Mapping[str, Mapping[str, Any]]) -> dict[str, EffectEstimate]:
    return {name: EffectEstimate(**estimate) for name, estimate in entries.items()}


@dataclass(frozen=True, slots=True)
class History:
    """The changes of a calibration since its fit."""

    medium_change: MediumChange | None = None
    updates: tuple[UpdateRecord, ...] = ()
    """The earliest first."""
    diagnosis: DiagnosisRecord | None = None
    diagnosis_runs: tuple[DiagnosisRun, ...] = ()
    """The earliest first; empty for a diagnosis that `calib fit` or a program started."""

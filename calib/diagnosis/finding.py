"""What a diagnosis found, as the command prints it and a calibration keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from calib.diagnosis.printed_patterns import ClosedForm
from calib.fitting.declared import PREFIXES
from calib.fitting.rounding import with_sigma
from calib.inference.residual_structure import Share


@dataclass(frozen=True, slots=True)
class ParameterEstimate:
    """A number of an effect."""

    value: float
    sigma: float
    unit: str

    def __str__(self) -> str:
        unit, factor = PREFIXES.get(self.unit, (self.unit, 1.0))
        return f"{with_sigma(self.value * factor, self.sigma * factor)} {unit}".rstrip()


PLAIN = {
    "absorbed": "the fit imitates it",
    "not asked for": "nothing points to it",
    "not finite": "cannot be fitted",
}
"""What people are told of a candidate, where its verdict in JSON says little to them."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One effect that was considered, at the step where it came closest to being accepted."""

    effect: str
    form: str
    """Which of an effect's forms: what lies behind a window, say. Empty where there is one."""
    chi2: float
    dof: int
    p_value: float
    absorbed: float
    """The fraction of it that the parameters fitted before can imitate."""
    held_out_px_before: float | None
    """Corners weighted by how surely they are predicted, and clipped where bad, so not quite the
    whole model's. None: the score was too low to fit it.
    """
    held_out_px_after: float | None
    gain_ci95: tuple[float, float] | None
    """px"""
    parameters: Mapping[str, ParameterEstimate]
    confounded_with: tuple[str, ...]
    accepted: bool
    verdict: str
    depth_bands_px: tuple[float, float] | None = None
    """Before and after, with near, middle and far views held out in turn.

    None: there are no such bands, or folds gave no gain.
    """

    @property
    def title(self) -> str:
        """The effect, and its form where there are several."""
        return f"{self.effect} ({self.form})" if self.form else self.effect

    @property
    def outcome(self) -> str:
        """The verdict in plain words."""
        return PLAIN.get(self.verdict, self.verdict)


@dataclass(frozen=True, slots=True)
class Family:
    """Effects of which one is present, and these views do not say which."""

    name: str
    """In plain words."""
    members: Mapping[str, float]
    """The probability of each, the most probable first."""
    experiment: str
    """The sentence that says what would decide."""

    def __str__(self) -> str:
        among = ", ".join(f"{name} ({chance:.2f})" for name, chance in self.members.items())
        return (
            f"What was found is {self.name}, but these views do not say what: {among}."
            f" {self.experiment}"
        )


@dataclass(frozen=True, slots=True)
class Quality:
    """How far a model is off."""

    rms_px: float
    rmse_cm: float
    held_out_px: float


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The whole finding."""

    noise_px: float
    """The noise floor, two-dimensional."""
    noise_from: str
    residual: tuple[Share, ...]
    """Of the fit that was diagnosed."""
    candidates: tuple[Candidate, ...]
    accepted: tuple[str, ...]
    """Of a family, the most probable member."""
    before: Quality
    after: Quality
    unexplained: float
    """The fraction of the residual's variance that is not noise, after."""
    organised_by: str
    """What organises it; empty where it is noise."""
    remarks: tuple[str, ...]
    """What cannot be told, a sentence each."""
    families: tuple[Family, ...] = ()
    """Of the accepted effects that these views cannot tell from others."""
    formulas: tuple[ClosedForm, ...] = ()
    """The closed forms nearest to an accepted free field, the best first."""

    def as_json(self) -> dict[str, Any]:
        """The contract's object."""
        before, after = asdict(self.before), asdict(self.after)
        return {
            "residual": {
                "rms_px": self.before.rms_px,
                "noise_px": self.noise_px,
                "noise_from": self.noise_from,
                "organised_by": [asdict(share) for share in self.residual],
            },
            "candidates": [asdict(candidate) for candidate in self.candidates],
            "accepted": list(self.accepted),
            "families": [asdict(family) for family in self.families],
            "formulas": [asdict(formula) for formula in self.formulas],
            "before": before,
            "after": after,
            "unexplained": {"fraction": self.unexplained, "organised_by": self.organised_by},
            "remarks": list(self.remarks),
        }

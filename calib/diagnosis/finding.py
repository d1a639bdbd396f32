"""The result of a diagnosis, which the command prints and the calibration keeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from html import escape
from typing import Any

from calib.calibration_content import Stage
from calib.diagnosis.printed_patterns import ClosedForm
from calib.fit_record.history import Family, Quality, fit_names
from calib.fitting.declared import PREFIXES
from calib.fitting.differing import Differing
from calib.fitting.evaluate import Evaluation
from calib.inference.residual_structure import VarianceShare
from calib.rounding import with_sigma
from calib.table import Table, TableSection


@dataclass(frozen=True, slots=True)
class ParameterEstimate:
    """The estimate of a parameter of an effect."""

    value: float
    sigma: float
    unit: str

    def __str__(self) -> str:
        unit, factor = PREFIXES.get(self.unit, (self.unit, 1.0))
        return f"{with_sigma(self.value * factor, self.sigma * factor)} {unit}".rstrip()


PLAIN = {
    "absorbed": "these views cannot tell it from fitted numbers",
    "not asked for": "no sign of it in the error",
    "not finite": "cannot be fitted",
    "not possible": "would have to be larger than is possible",
}
"""Plain words for verdicts whose JSON text is unclear."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A candidate effect, at the step where it came closest to acceptance."""

    effect: str
    form: str
    """The form of the effect, such as the medium behind a window; empty if there is one form."""
    chi2: float
    dof: int
    p_value: float
    absorbed: float
    """The fraction of the effect that the previously fitted parameters can imitate."""
    held_out_px_before: float | None
    """The held-out error without the effect. Corners are weighted by the precision of their
    prediction and clipped, so it differs slightly from that of the whole model. None: the score was
    too low for a fit.
    """
    held_out_px_after: float | None
    gain_ci95: tuple[float, float] | None
    """px"""
    parameters: Mapping[str, ParameterEstimate]
    confounded_with: tuple[str, ...]
    accepted: bool
    verdict: str
    varies: str | None = None
    """The way in which the effect's numbers differ from view to view, in a word of the command
    contract; None if they do not.
    """
    spread: Mapping[str, ParameterEstimate] = field(default_factory=dict)
    """The spread of numbers that differ: their root mean square deviations over the views."""
    from_file: str | None = None
    """The first picture after a change at one view."""
    depth_bands_px: tuple[float, float] | None = None
    """The errors without and with the effect, with near, middle and far views held out in turn.

    None: there are no such bands, or folds show no gain.
    """

    @property
    def title(self) -> str:
        """The effect, and its form if there are several."""
        form = self.form.replace("_", " ")
        return f"{self.effect} ({form})" if form else self.effect

    @property
    def outcome(self) -> str:
        """The verdict in plain words."""
        return PLAIN.get(self.verdict, self.verdict)


def _held_out(candidate: Candidate) -> str:
    before, after = candidate.held_out_px_before, candidate.held_out_px_after
    if before is None or after is None:
        return ""
    return f"{before:.3f} px without, {after:.3f} px with it"


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The result of a diagnosis."""

    noise_px: float | None
    """The two-dimensional noise floor; None if too few corners tell it."""
    noise_from: str
    residual: tuple[VarianceShare, ...]
    """The structure of the residual of the diagnosed fit."""
    candidates: tuple[Candidate, ...]
    accepted: tuple[str, ...]
    """The accepted effects; of a family, the most probable member."""
    base_quality: Quality
    final_quality: Quality
    unexplained: float | None
    """The fraction of the final residual's variance that is not noise; None if the noise is
    unknown.
    """
    organised_by: str
    """The coordinate that explains most of it; empty if it is noise."""
    remarks: tuple[str, ...]
    """Sentences on what the views leave open."""
    families: tuple[Family, ...] = ()
    """The families of accepted effects that these views cannot tell from others."""
    formulas: tuple[ClosedForm, ...] = ()
    """The closed forms nearest to an accepted free field, the best first."""
    differing: Differing | None = None
    """Numbers that differ from view to view beside the accepted effects; None if none do."""
    given_held_out_px: float | None = None
    """The error of the calibration as it was given, on views that no fit has seen, as `calib
    evaluate` measures it. None without such views. `base_quality` is that of the same calibration
    fitted again, without the bend of the board that its fit found.
    """
    given: Stage | None = None
    """The errors of that calibration on its own views, as its fit left them."""
    decided: bool = True
    """False if there were too few views to confirm any effect."""
    earlier: tuple[str, ...] = ()
    """The accepted effects that the calibration had already."""
    evaluation: Evaluation | None = None
    """That of the diagnosed calibration on views that no fit has seen; None without such views."""

    @property
    def added(self) -> tuple[str, ...]:
        """The accepted effects that the calibration did not have."""
        return tuple(name for name in self.accepted if name not in self.earlier)

    @property
    def headline(self) -> str:
        """The findings, in one sentence."""
        addition = f" beside {', '.join(self.earlier)}" if self.earlier else ""
        if self.added:
            return f"Found{addition}: {', '.join(self.added)}."
        if not self.decided:
            return "Not decided: there are too few views to confirm a cause."
        return (
            f"Nothing found{addition}: no known effect improves the held-out views by more than"
            " chance."
        )

    def table(self) -> Table:
        """Return the errors before and after, and the accepted effects, as a table."""
        errors = tuple(
            (name, f"{quality.rms_px:.3f} px", f"{quality.held_out_px:.3f} px", "")
            for name, quality in zip(
                fit_names(had_effects=bool(self.earlier)),
                (self.base_quality, self.final_quality),
                strict=True,
            )
        )
        effects = tuple(
            (
                candidate.title,
                "",
                _held_out(candidate),
                "; ".join(f"{name} {value}" for name, value in candidate.parameters.items()),
            )
            for candidate in self.candidates
            if candidate.accepted
        )
        sections = (
            TableSection("errors", "Error (root mean square)", errors),
            TableSection("effects", self.headline.split(":")[0], effects),
        )
        columns = ("", "fitted views", "held-out views", "estimate")
        return Table("Diagnosis", columns, sections)

    def _repr_html_(self) -> str:
        """Return the table and the remarks, which a notebook shows."""
        remarks = "".join(f"<li>{escape(remark)}</li>" for remark in self.remarks)
        return f"{self.table()._repr_html_()}<ul>{remarks}</ul>"

    def as_json(self) -> dict[str, Any]:
        """Return the JSON object of the command contract."""
        base_quality, final_quality = asdict(self.base_quality), asdict(self.final_quality)
        return {
            "residual": {
                "rms_px": self.base_quality.rms_px,
                "noise_px": self.noise_px,
                "noise_from": self.noise_from,
                "organised_by": [asdict(share) for share in self.residual],
            },
            "candidates": [asdict(candidate) for candidate in self.candidates],
            "accepted": list(self.accepted),
            "earlier": list(self.earlier),
            "families": [asdict(family) for family in self.families],
            "differs": self.differing.as_json() if self.differing else None,
            "formulas": [asdict(formula) for formula in self.formulas],
            "decided": self.decided,
            "given": {
                "rms_px": self.given.rms_px if self.given else None,
                "rmse_cm": self.given.rmse_cm if self.given else None,
                "held_out_px": self.given_held_out_px,
            },
            "before": base_quality,
            "after": final_quality,
            "unexplained": {"fraction": self.unexplained, "organised_by": self.organised_by},
            "remarks": list(self.remarks),
        }

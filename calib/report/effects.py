"""The section of a report on a diagnosis: the errors without and with the effects that it added,
and those that the views do not tell from them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

from calib.calibration import Calibration
from calib.diagnosis.effect_description import describe_estimates
from calib.effects.description import describe_effect
from calib.fit_record.history import DiagnosisRecord, fit_names
from calib.report.tables import bar
from calib.table import board_error, change, html_table

HELD_OUT = (
    "Held out: the error on views that were not fitted, without the effect and with it. This table"
    " weights each corner by its noise, and the first table does not."
)

PLAIN_FIT = "Plain fit: this model with a flat board and no effect."
NOTHING = (
    "calib diagnose found nothing: no effect that it knows improves held-out views beyond chance."
)
NOT_DECIDED = "calib diagnose decided nothing: there are too few views to confirm a cause."


@dataclass(frozen=True, slots=True)
class EffectRow:
    effect: str
    before_px: float
    """The held-out error without the effect."""
    after_px: float
    estimates: tuple[str, ...]
    """Texts for people: names, values, standard deviations and units."""
    description: str = ""


def effect_rows(calibration: Calibration) -> list[EffectRow]:
    """Return the accepted effects that the calibration keeps from its diagnosis."""
    diagnosis = calibration.history.diagnosis
    return [
        EffectRow(
            accepted.name,
            accepted.held_out_px_before,
            accepted.held_out_px_after,
            tuple(describe_estimates(accepted, calibration)),
            describe_effect(accepted.name, accepted.varies),
        )
        for accepted in (diagnosis.accepted if diagnosis else ())
    ]


def effects_html(rows: Sequence[EffectRow], calibration: Calibration) -> str:
    """Return the section as HTML; an empty text if there was no diagnosis and is no effect."""
    diagnosis = calibration.history.diagnosis
    if not rows:
        return _nothing_html(diagnosis) if diagnosis else ""
    diagnosis = diagnosis or DiagnosisRecord()
    largest = max(max(row.before_px, row.after_px) for row in rows)
    cells = [
        (
            f"<b>{escape(row.effect)}</b>",
            escape(row.description),
            f"{bar(row.before_px, largest)} {row.before_px:.3f} px",
            f"{bar(row.after_px, largest)} {row.after_px:.3f} px",
            change(row.after_px, row.before_px),
            "".join(f"<div>{escape(estimate)}</div>" for estimate in row.estimates),
        )
        for row in rows
    ]
    head = ("effect", "", "held out without", "held out with it", "change", "estimate")
    return (
        _errors_html(diagnosis)
        + "<h3>Effects found</h3>"
        + html_table(head, cells)
        + f"<p>{HELD_OUT}</p>"
        + _families_html(diagnosis)
        + _considered_html(diagnosis)
    )


def _considered_html(diagnosis: DiagnosisRecord) -> str:
    """Return the effects that were not accepted, by their outcome."""
    from calib.diagnosis.finding import PLAIN  # which a plain fit need not load

    names_by_outcome: dict[str, list[str]] = {}
    for candidate in diagnosis.document.get("candidates", ()):
        if not candidate["accepted"]:
            form = f" ({candidate['form']})".replace("_", " ") if candidate.get("form") else ""
            outcome = PLAIN.get(candidate["verdict"], candidate["verdict"])
            names_by_outcome.setdefault(outcome, []).append(f"{candidate['effect']}{form}")
    items = "".join(
        f"<li>{escape(outcome)}: {escape(', '.join(names))}</li>"
        for outcome, names in names_by_outcome.items()
    )
    if not items:
        return ""
    return f"<details><summary>What else was scored</summary><ul>{items}</ul></details>"


def _nothing_html(diagnosis: DiagnosisRecord) -> str:
    """Return the section of a diagnosis that found nothing."""
    if not diagnosis.decided:
        return f"<p>{NOT_DECIDED}</p>{_families_html(diagnosis)}"
    error = (
        f" The error on held-out views is {diagnosis.qualities[0].held_out_px:.3f} px."
        if diagnosis.qualities
        else ""
    )
    return f"<p>{NOTHING}{error}</p>{_families_html(diagnosis)}{_considered_html(diagnosis)}"


def _families_html(diagnosis: DiagnosisRecord) -> str:
    return "".join(f"<p>{escape(str(family))}</p>" for family in diagnosis.families)


def _errors_html(diagnosis: DiagnosisRecord) -> str:
    """Return the table of the errors of all views; empty if the diagnosis did not measure them."""
    if len(diagnosis.qualities) < 2:
        return ""
    head = ("error (root mean square)", "fitted views", "on the board", "held-out views")
    note = "" if diagnosis.had_effects else f"<p>{PLAIN_FIT}</p>"
    return html_table(head, list(_error_rows(diagnosis))) + note


def _error_rows(diagnosis: DiagnosisRecord) -> Iterator[tuple[str, ...]]:
    first = diagnosis.qualities[0]
    largest = max(max(errors.rms_px, errors.held_out_px) for errors in diagnosis.qualities)
    names = fit_names(had_effects=diagnosis.had_effects)
    for name, errors in zip(names, diagnosis.qualities, strict=True):
        fallen = f" ({change(errors.held_out_px, first.held_out_px)})" if errors != first else ""
        yield (
            name,
            f"{bar(errors.rms_px, largest)} {errors.rms_px:.3f} px",
            board_error(errors.rmse_cm),
            f"{bar(errors.held_out_px, largest)} {errors.held_out_px:.3f} px{fallen}",
        )

"""The section of a report on the effects that a diagnosis added: the held-out error before and
after.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from calib.calibration import Calibration
from calib.diagnosis.effect_description import describe_estimates
from calib.report.tables import bar
from calib.table import change, html_table


@dataclass(frozen=True, slots=True)
class EffectRow:
    effect: str
    before_px: float
    """The held-out error without the effect."""
    after_px: float
    parameters: str
    """Text for people: names, values, standard deviations and units."""


def effect_rows(calibration: Calibration) -> list[EffectRow]:
    """Return the accepted effects that the calibration keeps from its diagnosis."""
    diagnosis = calibration.history.diagnosis
    return [
        EffectRow(
            accepted.name,
            accepted.held_out_px_before,
            accepted.held_out_px_after,
            "; ".join(describe_estimates(accepted, calibration)),
        )
        for accepted in (diagnosis.accepted if diagnosis else ())
    ]


def effects_html(rows: Sequence[EffectRow]) -> str:
    """Return the section as HTML; an empty text without effects."""
    if not rows:
        return ""
    largest = max(max(row.before_px, row.after_px) for row in rows)
    cells = [
        (
            f"<b>{escape(row.effect)}</b>",
            f"{bar(row.before_px, largest)} {row.before_px:.3f} px",
            f"{bar(row.after_px, largest)} {row.after_px:.3f} px",
            change(row.after_px, row.before_px),
            escape(row.parameters),
        )
        for row in rows
    ]
    return html_table(("effect", "held out before", "held out after", "change", "estimate"), cells)

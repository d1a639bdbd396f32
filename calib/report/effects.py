"""What each effect that was added to the model changes on views that were held out."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from calib.calibration import Calibration
from calib.diagnosis.finding import ParameterEstimate
from calib.diagnosis.found import found
from calib.report.tables import bar, table


@dataclass(frozen=True, slots=True)
class EffectRow:
    effect: str
    before_px: float
    """Held out, without it."""
    after_px: float
    parameters: str
    """As people read them: names, values, standard deviations, units."""


def effect_rows(calibration: Calibration) -> list[EffectRow]:
    """What a diagnosis found, as the calibration keeps it."""
    candidates = calibration.settings.get("diagnosis", {}).get("candidates", [])
    return [
        EffectRow(
            one["effect"],
            one["held_out_px_before"],
            one["held_out_px_after"],
            "; ".join(
                found(
                    one["effect"],
                    calibration,
                    {name: ParameterEstimate(**said) for name, said in one["parameters"].items()},
                )
            ),
        )
        for one in candidates
        if one["accepted"]
    ]


def effects_html(rows: Sequence[EffectRow]) -> str:
    """Empty without effects."""
    if not rows:
        return ""
    most = max(max(row.before_px, row.after_px) for row in rows)
    cells = [
        (
            f"<b>{escape(row.effect)}</b>",
            f"{bar(row.before_px, most)} {row.before_px:.3f} px",
            f"{bar(row.after_px, most)} {row.after_px:.3f} px",
            f"{100 * (row.after_px / row.before_px - 1):+.0f} %",
            escape(row.parameters),
        )
        for row in rows
    ]
    return table(("effect", "held out before", "and after", "change", "what it found"), cells)

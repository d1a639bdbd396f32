"""Tables of a report: the stages of the fit, and the parameters of camera and cover."""

from collections.abc import Sequence
from html import escape

from calib.fitting.declared import DECLARED, Comparison, comparisons, effect_comparisons
from calib.report.evidence import Evidence

MEANING = {
    "pinhole": "the camera alone, with its lens",
    "cover": "through the smooth cover as the session describes it",
    "cover+rbf": "with the relief of its outer surface",
    "cover+rbf+effects": "with the effects that the diagnosis found",
}


def html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of HTML cells. On a narrow screen, each cell is a line with its label."""
    first = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(f"<tr>{''.join(map(_cell, head, row))}</tr>" for row in rows)
    return (
        "<div"
        f' class="wide"><table><thead><tr>{first}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def _cell(label: str, cell: str) -> str:
    if not cell:
        return "<td></td>"
    attribute = f' data-label="{escape(label)}"' if label else ""
    return f"<td{attribute}><div>{cell}</div></td>"


def bar(value: float, full_length: float) -> str:
    """Return a bar whose length shows a value in relation to `full_length`."""
    return (
        '<span class="bar" style="--part:'
        f' {min(1.0, max(0.0, value / full_length)) if full_length > 0 else 0:.3f}"></span>'
    )


def stages_html(evidence: Evidence) -> str:
    """Return the table of the fit's stages and their errors."""
    stages = evidence.calibration.stages
    largest = max(stage.rms_px for stage in stages)
    rows = [
        (
            f"<b>{escape(stage.title)}</b>",
            escape(MEANING.get(stage.name, "")),
            f"{bar(stage.rms_px, largest)} {stage.rms_px:.3f} px",
            f"{stage.rmse_cm:.4f} cm",
            "" if stage is stages[0] else f"{100 * (stage.rms_px / stages[0].rms_px - 1):+.0f} %",
        )
        for stage in stages
    ]
    return html_table(
        ("stage", "", "reprojection error (RMS)", "on the board", "against the camera alone"), rows
    )


def parameters_html(evidence: Evidence) -> str:
    """Return the table of every declared number and its estimate, with the increments of effects,
    and of the parameters that only effects have.
    """
    effect_parameters = list(effect_comparisons(evidence.calibration))
    rows = [*map(_row, comparisons(evidence.calibration)), *map(_row, effect_parameters)]
    numbers = html_table(
        ("quantity", "declared ± tolerance", "estimated ± sigma", "difference"), rows
    )
    if not effect_parameters:
        return numbers
    names = escape(", ".join(parameter.name for parameter in effect_parameters))
    return numbers + f"<p>No session declares {names}: the table shows the assumed value.</p>"


def _row(comparison: Comparison) -> tuple[str, str, str, str]:
    declared = (
        comparison.stated
        if comparison.source == DECLARED
        else f"{comparison.stated} <small>{escape(comparison.source)}</small>"
    )
    if comparison.held:
        return escape(comparison.name), declared, "held", ""
    source = f" <small>by {escape(comparison.effect)}</small>" if comparison.effect else ""
    return (
        escape(comparison.name),
        declared,
        comparison.estimated + source,
        f"{comparison.normalised_deviation:.1f} sigma",
    )

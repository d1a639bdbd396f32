"""The stages of the fit, and the parameters of camera and cover."""

from collections.abc import Sequence
from html import escape

from calib.fitting.declared import DECLARED, Comparison, comparisons, own_parameters
from calib.report.evidence import Evidence

MEANING = {
    "pinhole": "the camera alone, with its lens",
    "cover": "through the smooth cover as the session describes it",
    "cover+rbf": "with the relief of its outer surface",
    "cover+rbf+effects": "with the effects that the diagnosis found",
}


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Cells are HTML already; where there is no room, each comes below the other beside its
    label.
    """
    first = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(f"<tr>{''.join(map(_cell, head, row))}</tr>" for row in rows)
    return (
        "<div"
        f' class="wide"><table><thead><tr>{first}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def _cell(label: str, cell: str) -> str:
    if not cell:
        return "<td></td>"
    said = f' data-label="{escape(label)}"' if label else ""
    return f"<td{said}><div>{cell}</div></td>"


def bar(value: float, whole: float) -> str:
    """A number's length beside others of the same whole."""
    return (
        '<span class="bar" style="--part:'
        f' {min(1.0, max(0.0, value / whole)) if whole > 0 else 0:.3f}"></span>'
    )


def stages_html(evidence: Evidence) -> str:
    stages = evidence.calibration.stages
    most = max(stage.rms_px for stage in stages)
    rows = [
        (
            f"<b>{escape(stage.title)}</b>",
            escape(MEANING.get(stage.name, "")),
            f"{bar(stage.rms_px, most)} {stage.rms_px:.3f} px",
            f"{stage.rmse_cm:.4f} cm",
            "" if stage is stages[0] else f"{100 * (stage.rms_px / stages[0].rms_px - 1):+.0f} %",
        )
        for stage in stages
    ]
    return table(
        ("stage", "", "reprojection error (RMS)", "on the board", "against the camera alone"), rows
    )


def parameters_html(evidence: Evidence) -> str:
    """Every number as it was declared and as it was estimated, an effect's increment added; then
    what effects have of their own.
    """
    own = list(own_parameters(evidence.calibration))
    rows = [*map(_row, comparisons(evidence.calibration)), *map(_row, own)]
    numbers = table(("quantity", "declared ± tolerance", "estimated ± sigma", "apart"), rows)
    if not own:
        return numbers
    return (
        numbers
        + f"<p>No session declares {escape(', '.join(one.name for one in own))}: what is supposed"
        " stands for it.</p>"
    )


def _row(one: Comparison) -> tuple[str, str, str, str]:
    said = (
        one.stated
        if one.source == DECLARED
        else f"{one.stated} <small>{escape(one.source)}</small>"
    )
    if one.held:
        return escape(one.name), said, "held", ""
    by = f" <small>by {escape(one.effect)}</small>" if one.effect else ""
    return escape(one.name), said, one.estimated + by, f"{one.normalised_deviation:.1f} sigma"

"""The stages of the fit, and the parameters of camera and cover."""

from collections.abc import Sequence
from html import escape

from calib.fitting.declared import Comparison, comparisons
from calib.report.evidence import Evidence

MEANING = {
    "pinhole": "the camera alone, with its lens",
    "cover": "through the smooth cover as the session describes it",
    "cover+rbf": "with the relief of its outer surface",
    "cover+rbf+effects": "with the effects that the diagnosis found",
}


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Cells are HTML already."""
    first = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<div class="wide"><table><thead><tr>{first}</tr></thead><tbody>{body}</tbody></table></div>'


def bar(value: float, whole: float) -> str:
    """A number's length beside others of the same whole."""
    return f'<span class="bar" style="width: {9 * min(1.0, max(0.0, value / whole)) if whole > 0 else 0:.2f}rem"></span>'


def stages_html(evidence: Evidence) -> str:
    stages = evidence.calibration.stages
    most = max(stage.rms_px for stage in stages)
    rows = [
        (
            f"<b>{escape(stage.name)}</b>",
            escape(MEANING.get(stage.name, "")),
            f"{bar(stage.rms_px, most)} {stage.rms_px:.3f} px",
            f"{stage.rmse_cm:.4f} cm",
            "" if stage is stages[0] else f"{100 * (stage.rms_px / stages[0].rms_px - 1):+.0f} %",
        )
        for stage in stages
    ]
    return table(("stage", "", "reprojection error (RMS)", "on the board", "against the pinhole"), rows)


def parameters_html(evidence: Evidence) -> str:
    """Every number as it was declared and as it was estimated."""
    return table(("", "declared", "estimated", "apart"), [_row(one) for one in comparisons(evidence.calibration)])


def _row(one: Comparison) -> tuple[str, str, str, str]:
    if one.held:
        return escape(one.name), f"{one.declared:.6g} {one.unit}".rstrip(), "held", ""
    declared, estimated = f"{one.declared:.6g} ± {one.tolerance:.2g}", f"{one.estimate:.6g} ± {one.sigma:.2g}"
    return escape(one.name), f"{declared} {one.unit}".rstrip(), f"{estimated} {one.unit}".rstrip(), f"{one.apart:.1f} sigma"

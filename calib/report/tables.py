"""The stages of the fit, and the parameters of camera and cover."""

from collections.abc import Sequence
from html import escape

from calib.optics.lens_model import COEFFICIENTS
from calib.report.evidence import Evidence
from calib.session.camera import COEFFICIENT, PINHOLE
from calib.session.cover import SHAPES
from calib.session.schema import Number, Quantity

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
    camera, cover = evidence.calibration.camera.intrinsics, evidence.calibration.cover
    assert camera
    parameters = [(q, f"cover.{name}", cover.parameters[name]) for q in SHAPES[cover.shape] for name in q.names]
    parameters += [(q, f"camera.{q.key}", n) for q, n in zip(PINHOLE, (camera.fx, camera.fy, camera.cx, camera.cy), strict=True)]
    parameters += [
        (COEFFICIENT, f"camera.{name}", n) for name, n in zip(COEFFICIENTS, camera.distortion, strict=False) if n.value or n.sigma
    ]
    return table(("number", "value", ""), [_row(*entry) for entry in parameters])


def _row(quantity: Quantity, name: str, number: Number) -> tuple[str, str, str]:
    unit, per_si = ("px", 1.0) if quantity in PINHOLE else quantity.unit
    value = f"{number.value * per_si:.6g} {unit}".rstrip()
    return escape(name), value, f"estimated, ± {number.sigma * per_si:.2g} {unit}".rstrip() if number.sigma else "held"

"""Figure: the board errors of the corners, without and with the model (the paper's Fig. 6)."""

from dataclasses import dataclass

import numpy as np

from calib.fitting.fitted import PINHOLE_STAGE
from calib.report.corners import corner_step, shown_corners
from calib.report.evidence import Array, Evidence
from calib.report.figure import Drawing

MIN_ENLARGEMENT = 2.0
"""The errors with the model get a panel of their own if the shared one is larger by this factor."""


@dataclass(frozen=True, slots=True)
class ErrorPanel:
    """Errors on the board that are shown together."""

    name: str
    errors: Array
    """(M, 2) mm"""
    reach: float
    """mm, the limit of both axes."""

    @property
    def title(self) -> str:
        return f"{self.name}: {float(np.sqrt(np.nanmean((self.errors**2).sum(-1)))):.2g} mm RMS"


def error_panels(evidence: Evidence) -> list[ErrorPanel]:
    """Return the errors with the model and, beside them, those without cover or lens."""
    with_model = 1e3 * evidence.residuals.board.numpy()
    own_reach = _reach(with_model)
    if not evidence.bare_residuals:
        return [ErrorPanel("with the model", with_model, own_reach)]
    covered = evidence.calibration.cover.shape != "none"
    title = "fitted lens alone, no cover" if covered else "without lens distortion"
    without = 1e3 * evidence.bare_residuals.board.numpy()
    reach = _reach(without)
    enlargement = reach / own_reach
    panels = [
        ErrorPanel(title, without, reach),
        ErrorPanel("with the model", with_model, reach),
    ]
    if enlargement > MIN_ENLARGEMENT:
        panels.append(
            ErrorPanel(f"the same, enlarged {enlargement:.0f} times", with_model, own_reach)
        )
    return panels


def board_errors(evidence: Evidence) -> Drawing:
    is_flat = evidence.calibration.board.is_flat
    plane = "the board" if is_flat else "a plane through the point that faces the camera"
    axes = "board" if is_flat else "the camera's"
    rows = shown_corners(evidence)
    panels = error_panels(evidence)
    return Drawing(
        "board-errors",
        "Corner errors on the board",
        f"For each detected corner, the point where its ray meets {plane} minus the true corner,"
        f" in {axes} coordinates. The stronger the colour, the larger the error of the view. Point"
        " at a dot, and all dots of its view turn orange: if they lie to one side, the view has an"
        " error of its own. Noise alone gives a small round cloud around zero. One dot in two"
        " hundred may lie outside the panel." + _unfitted_lens(evidence) + _thinned(evidence),
        {
            "errors": [panel.errors[rows] for panel in panels[:2]],
            "panels": [
                {"title": panel.title, "errors": min(place, 1), "reach": panel.reach}
                for place, panel in enumerate(panels)
            ],
        },
    )


def _unfitted_lens(evidence: Evidence) -> str:
    """Return a sentence on the stage "camera alone", whose error is not that of the first panel."""
    stage = evidence.calibration.stages[0]
    if evidence.calibration.cover.shape == "none" or stage.name != PINHOLE_STAGE:
        return ""
    return (
        f' The first panel has the fitted lens. The stage "{stage.title}" has the lens as it was'
        " before the fit, so its error differs."
    )


def _thinned(evidence: Evidence) -> str:
    step = corner_step(evidence)
    return f" The figures of this page show one corner in {step}." if step > 1 else ""


def _reach(errors: Array) -> float:
    """Return the axis limit in mm that holds 99.5 % of the errors in both directions."""
    return float(1.15 * np.nanquantile(np.abs(errors).max(-1), 0.995) + 1e-9)

"""Figure: the board errors of the corners, without and with the model (the paper's Fig. 6)."""

from dataclasses import dataclass

import numpy as np

from calib.report.corners import corner_step, shown_corners
from calib.report.evidence import Array, Evidence
from calib.report.figure import Drawing

MIN_CLOSER = 2.0
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
    left_out = "the cover" if covered else "lens distortion"
    without = 1e3 * evidence.bare_residuals.board.numpy()
    reach = _reach(without)
    closer = reach / own_reach
    panels = [
        ErrorPanel(f"without {left_out}", without, reach),
        ErrorPanel("with the model", with_model, reach),
    ]
    if closer > MIN_CLOSER:
        panels.append(ErrorPanel(f"the same, {closer:.0f} times closer", with_model, own_reach))
    return panels


def board_errors(evidence: Evidence) -> Drawing:
    rows = shown_corners(evidence)
    panels = error_panels(evidence)
    return Drawing(
        "board-errors",
        "Corner errors on the board",
        "For each detected corner, the point where its ray meets the board minus the true corner,"
        " in board coordinates. The stronger the colour, the larger the error of the view. Point at"
        " a dot, and all dots of its view turn orange: if they lie to one side, the view has an"
        " error of its own. Noise alone gives a small round cloud around zero. One dot in two"
        " hundred may lie outside the panel." + _thinned(evidence),
        {
            "errors": [panel.errors[rows] for panel in panels[:2]],
            "panels": [
                {"title": panel.title, "errors": min(place, 1), "reach": panel.reach}
                for place, panel in enumerate(panels)
            ],
        },
    )


def _thinned(evidence: Evidence) -> str:
    step = corner_step(evidence)
    return f" The figures of this page show one corner in {step}." if step > 1 else ""


def _reach(errors: Array) -> float:
    """Return the axis limit in mm that holds 99.5 % of the errors in both directions."""
    return float(1.15 * np.nanquantile(np.abs(errors).max(-1), 0.995) + 1e-9)

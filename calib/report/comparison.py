"""Figure: the residuals before and after a diagnosis, side by side."""

from pathlib import Path

from calib.calibration import Calibration
from calib.errors import RefracalError
from calib.report.corners import shown_corners
from calib.report.evidence import Evidence, gather_evidence
from calib.report.figure import Drawing
from calib.report.payload import Data
from calib.report.residual_maps import (
    Arrows,
    ArrowScales,
    arrows_over_board,
    arrows_over_image,
    board_span,
    typical_length,
)


def undiagnosed(calibration: Calibration) -> Calibration | None:
    """Read the calibration that the last `calib diagnose` started from; None if there was none, or
    if it is not there any more.
    """
    runs = calibration.history.diagnosis_runs
    if not runs:
        return None
    try:
        return Calibration.load(Path(runs[-1].calibration))
    except (RefracalError, OSError):
        return None


def diagnosis_comparison(before: Calibration | None, after: Evidence) -> Drawing | None:
    """Return None without an earlier calibration of the same views, or if no effect was added."""
    if not before or len(before.effects) == len(after.calibration.effects):
        return None
    if [view.name for view in before.views] != [view.name for view in after.calibration.views]:
        return None
    earlier = gather_evidence(before, after.depths)
    over_image = arrows_over_image(earlier)
    over_board = arrows_over_board(earlier)
    scales = ArrowScales.of(earlier, typical_length(over_image, over_board))
    return Drawing(
        "comparison",
        "Residuals of the given fit, and with effects",
        "Mean residuals over the picture and over the board, and the distribution of all residuals:"
        " of the fit that calib diagnose was given, and with the effects that it found, at the same"
        " scales."
        f" {scales.caption} Last: the error of each view; below the diagonal it became smaller.",
        {
            "before": _side(earlier, over_image, over_board),
            "after": _side(after, arrows_over_image(after), arrows_over_board(after)),
            "scales": scales.data(),
            "span": 1e3 * board_span(earlier),
        },
    )


def _side(evidence: Evidence, over_image: Arrows, over_board: Arrows) -> Data:
    return {
        "image": over_image.data(),
        "board": over_board.data(),
        "errors": evidence.errors[shown_corners(evidence)],
        "views": evidence.rms_by_view,
        "noise": evidence.calibration.noise_px,
        "rms": evidence.residuals.rms_px,
    }

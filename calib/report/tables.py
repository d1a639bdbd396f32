"""Tables of a report: the stages of the fit, and the parameters of camera and cover."""

from html import escape

from calib.fitting.description import describe
from calib.report.evidence import Evidence
from calib.table import board_error, html_table


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
            escape(stage.meaning),
            f"{bar(stage.rms_px, largest)} {stage.rms_px:.3f} px",
            board_error(stage.rmse_cm),
        )
        for stage in stages
    ]
    return html_table(("stage", "", "reprojection error (RMS)", "on the board"), rows)


def parameters_html(evidence: Evidence) -> str:
    """Return the table of what was calibrated (`calib.fitting.description`)."""
    return describe(evidence.calibration).html()

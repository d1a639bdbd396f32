"""Figure: the corners in the image, their depths, and their exit points on the glass.

Elsewhere the model extrapolates.
"""

from calib.report.chart import ChartPanel, exit_points
from calib.report.corners import shown_corners
from calib.report.evidence import Evidence
from calib.report.figure import Drawing

BARS = 16


def image_title(evidence: Evidence) -> str:
    return f"image: {100 * evidence.covered:.0f} % of the cells"


def depth_title(evidence: Evidence) -> str:
    near, far = evidence.reach
    return f"{evidence.distance_name}: {near:.2g} to {far:.2g} m"


def has_chart(evidence: Evidence) -> bool:
    """True if there is glass with a chart; a window that only the diagnosis knows has none."""
    return evidence.calibration.cover.shape != "none"


def corner_coverage(evidence: Evidence) -> Drawing:
    data: dict[str, object] = {
        "counts": evidence.counts,
        "imageTitle": image_title(evidence),
        "depthTitle": depth_title(evidence),
    }
    caption = "Empty cells hold no corner: there the model is extrapolated from its neighbours."
    if has_chart(evidence):
        panel = ChartPanel.of(evidence)
        exits = exit_points(evidence, evidence.pixels[shown_corners(evidence)])
        data |= {**panel.data(), "exits": panel.place(exits)}
        caption += " The frame on the glass is the picture's border."
    return Drawing("coverage", "Where the corners were", caption, data)

"""The outer surface of the cover, spread flat: where pixels see through it, in units that people
read.
"""

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from calib.report.evidence import Array, Evidence
from calib.report.ink import FAINT

DEGREES = 180 / np.pi
UPRIGHT = (("along the axis (mm)", 1e3), ("around the axis (°)", DEGREES))
CHARTS = {
    "cone": UPRIGHT,
    "cylinder": UPRIGHT,
    "flat": (("y (mm)", 1e3), ("x (mm)", 1e3)),
    "dome": (("elevation (°)", DEGREES), ("azimuth (°)", DEGREES)),
}
"""How each shape's two chart coordinates are labelled, and the factor from SI to that unit.

The first is drawn downwards.
"""


def hits(evidence: Evidence, pixels: Array) -> Array:
    """(N, 2) px to the (N, 2) chart coordinates, SI, at which their rays leave the glass; NaN where
    none does.
    """
    outer = evidence.path.cover[-1]
    rays = evidence.path.trace(torch.from_numpy(pixels), evidence.values)
    _, values = evidence.path.adjust_pixels(torch.from_numpy(pixels), evidence.values)
    chart = torch.stack(outer.surface.chart(outer.frame.at(values).enter(rays.origin)), -1)
    return torch.where((rays.failure != 0).unsqueeze(-1), torch.nan, chart).numpy()


def units(evidence: Evidence) -> tuple[float, float]:
    """From the two chart coordinates, SI, to what is drawn."""
    (_, first), (_, second) = CHARTS[evidence.calibration.cover.shape]
    return first, second


def drawn(evidence: Evidence, chart: Array) -> tuple[Array, Array]:
    """(N, 2) chart coordinates to (N,) across and (N,) down a panel."""
    first, second = units(evidence)
    return chart[:, 1] * second, chart[:, 0] * first


def border(evidence: Evidence) -> Array:
    """(N, 2) chart coordinates along the image's border, without what no ray reaches."""
    camera = evidence.calibration.camera
    go, stay = np.linspace(0, 1, 40), np.zeros(40)
    sides = ((go, stay), (1 + stay, go), (1 - go, 1 + stay), (stay, 1 - go))
    found = hits(
        evidence,
        np.concatenate([np.stack(side, -1) for side in sides]) * [camera.width, camera.height]
        - 0.5,
    )
    return np.asarray(found[np.isfinite(found).all(-1)])


def chart_axes(axes: Axes, evidence: Evidence) -> Polygon:
    """Labels, and the border of what the image sees."""
    edge = np.stack(drawn(evidence, border(evidence)), -1)
    frame = Polygon(edge, fill=False, edgecolor=FAINT, linewidth=0.9)
    axes.add_patch(frame)
    (down, _), (across, _) = CHARTS[evidence.calibration.cover.shape]
    (left, top), (right, bottom) = edge.min(0), edge.max(0)
    pad_x, pad_y = 0.04 * (right - left), 0.04 * (bottom - top)
    axes.set(
        xlabel=across,
        ylabel=down,
        xlim=(left - pad_x, right + pad_x),
        ylim=(bottom + pad_y, top - pad_y),
    )
    return frame

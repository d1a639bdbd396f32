"""The chart of the outer surface: exit points of rays in mm and degrees, and its axes."""

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from calib.optics.exposure import MIDDLE
from calib.report.evidence import Array, Evidence
from calib.report.ink import FAINT
from calib.session.shapes.registry import find_shape
from calib.session.shapes.shape import ChartAxis


def exit_points(evidence: Evidence, pixels: Array) -> Array:
    """Return the (N, 2) chart coordinates, SI, where the rays of (N, 2) px leave the glass; NaN
    where no ray does.
    """
    outer = evidence.path.cover[-1]
    rays = evidence.path.trace(torch.from_numpy(pixels), evidence.values, MIDDLE)
    _, values = evidence.path.adjust_pixels(torch.from_numpy(pixels), evidence.values, MIDDLE)
    chart = torch.stack(outer.surface.chart(outer.frame.at(values).enter(rays.origin)), -1)
    return torch.where((rays.failure != 0).unsqueeze(-1), torch.nan, chart).numpy()


def chart_scale(evidence: Evidence) -> tuple[float, float]:
    """Return the factors from the two chart coordinates, SI, to the drawn units."""
    first, second = _chart(evidence)
    return first.per_si, second.per_si


def chart_to_panel(evidence: Evidence, chart: Array) -> tuple[Array, Array]:
    """Convert (N, 2) chart coordinates to (N,) horizontal and (N,) vertical panel coordinates."""
    first, second = chart_scale(evidence)
    return chart[:, 1] * second, chart[:, 0] * first


def border(evidence: Evidence) -> Array:
    """Return (N, 2) chart coordinates of the image border, without points that no ray reaches."""
    camera = evidence.calibration.camera
    ramp, zero = np.linspace(0, 1, 40), np.zeros(40)
    sides = ((ramp, zero), (1 + zero, ramp), (1 - ramp, 1 + zero), (zero, 1 - ramp))
    points = exit_points(
        evidence,
        np.concatenate([np.stack(side, -1) for side in sides]) * [camera.width, camera.height]
        - 0.5,
    )
    return np.asarray(points[np.isfinite(points).all(-1)])


def chart_axes(axes: Axes, evidence: Evidence) -> Polygon:
    """Label the axes, and draw the border of the region that the image sees."""
    edge = np.stack(chart_to_panel(evidence, border(evidence)), -1)
    frame = Polygon(edge, fill=False, edgecolor=FAINT, linewidth=0.9)
    axes.add_patch(frame)
    first, second = _chart(evidence)
    (x_min, y_min), (x_max, y_max) = edge.min(0), edge.max(0)
    pad_x, pad_y = 0.04 * (x_max - x_min), 0.04 * (y_max - y_min)
    axes.set(
        xlabel=second.label,
        ylabel=first.label,
        xlim=(x_min - pad_x, x_max + pad_x),
        ylim=(y_max + pad_y, y_min - pad_y),
    )
    return frame


def _chart(evidence: Evidence) -> tuple[ChartAxis, ChartAxis]:
    chart = find_shape(evidence.calibration.cover.covers[-1].shape).chart
    assert chart
    return chart

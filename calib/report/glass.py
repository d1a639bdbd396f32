"""Figure: the relief of the outer surface, its standard deviation, and the corners' exit points."""

from dataclasses import dataclass

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.path import Path
from numpy.typing import NDArray

from calib.estimation.covariance import covariance_root
from calib.optics.relief import Relief
from calib.report.chart import border, chart_axes, chart_scale, chart_to_panel, exit_points
from calib.report.evidence import Array, Evidence
from calib.report.figure import Drawing
from calib.report.ink import (
    INK,
    ONE_SIDED,
    TWO_SIDED,
    colour_bar,
    draw_svg,
    label_lines,
    side_by_side,
)

NODES = (81, 61)
"""Columns and rows of the grid over the chart."""
PANEL = (3.9, 3.0)
"""Width and height in inches."""


@dataclass(frozen=True, slots=True)
class Heights:
    """The relief over the chart, minus its mean over the visible part."""

    x: Array
    """(w,) horizontal coordinates of the panel."""
    y: Array
    """(h,) vertical coordinates of the panel."""
    visible: NDArray[np.bool_]
    """(h, w) true where the image sees the glass."""
    height: Array
    """(h, w) um"""
    sigma: Array | None
    """(h, w) um; None where the fit estimated no covariance."""
    mean: float
    """um"""
    mean_sigma: float


def glass_surface(evidence: Evidence) -> Drawing | None:
    """Return None without a relief."""
    relief = evidence.calibration.relief
    if not relief:
        return None
    glass = _heights(evidence, relief)
    low, high = _range(glass.height, glass)
    limit = max(-low, high) or 1.0

    def field(
        figure: Figure,
        axes: Axes,
        values: Array,
        cmap: Colormap,
        limits: tuple[float, float],
        extend: str,
    ) -> Polygon:
        frame = chart_axes(axes, evidence)
        extent = (glass.x[0], glass.x[-1], glass.y[-1], glass.y[0])
        shown = axes.imshow(
            values, cmap=cmap, vmin=limits[0], vmax=limits[1], extent=extent, aspect="auto"
        )
        shown.set_clip_path(frame)
        colour_bar(figure, shown, axes, "µm", extend)
        return frame

    def paint(figure: Figure) -> None:
        panels = side_by_side(
            figure,
            [PANEL[0]] * (1 if glass.sigma is None else 2),
            (0.65, 0.95)[: 1 if glass.sigma is None else 2],
        )
        frame = field(figure, panels[0], glass.height, TWO_SIDED, (-limit, limit), "neither")
        if high > low:
            lines = panels[0].contour(
                glass.x,
                glass.y,
                np.where(glass.visible, glass.height, np.nan),
                7,
                colors=[INK],
                linewidths=0.7,
            )
            label_lines(panels[0], lines, size=8, marks=frame.get_xy())
        panels[0].set_title(f"height: {low:+.2g} to {high:+.2g} µm")
        if glass.sigma is not None:
            field(
                figure,
                panels[1],
                glass.sigma,
                ONE_SIDED,
                (0, 2 * float(np.median(glass.sigma[glass.visible]))),
                "max",
            )
            panels[1].plot(
                *chart_to_panel(evidence, exit_points(evidence, evidence.pixels)),
                ".",
                markersize=1.8,
                color="#808080",
                rasterized=True,
            )
            smallest, largest = _range(glass.sigma, glass)
            panels[1].set_title(f"its standard deviation: {smallest:.2g} to {largest:.2g} µm")
            panels[1].set_ylabel("")

    mean = f"{round(glass.mean, 1) + 0.0}" + (
        "" if glass.sigma is None else f" ± {glass.mean_sigma:.1f}"
    )
    caption = (
        f"The relief of the outer surface where the image sees it, minus its mean of {mean} µm. An"
        " even layer hardly bends light, so the mean is known less well than the unevenness."
    )
    if glass.sigma is not None:
        caption += " Dots: exit points of the corners' rays. Far from them, the prior decides."
    return Drawing("glass", "The glass surface", draw_svg("glass", PANEL, paint), caption)


def _heights(evidence: Evidence, relief: Relief) -> Heights:
    edge = border(evidence)
    low = edge.min(0)
    high = edge.max(0)
    vertical = np.linspace(low[0], high[0], NODES[1])
    horizontal = np.linspace(low[1], high[1], NODES[0])
    points = np.stack(np.meshgrid(vertical, horizontal, indexing="ij"), -1).reshape(-1, 2)
    visible = Path(edge).contains_points(points)
    vertical_bells = relief.gaussians(torch.from_numpy(vertical), 0)[0].numpy()
    horizontal_bells = relief.gaussians(torch.from_numpy(horizontal), 1)[0].numpy()
    basis = np.einsum("ip,jq->pqij", vertical_bells, horizontal_bells)
    basis = basis.reshape(len(points), -1)  # (h w, amplitudes)
    mean = basis[visible].mean(0)
    amplitudes = evidence.calibration.amplitudes.ravel()

    shape = len(vertical), len(horizontal)
    to_y, to_x = chart_scale(evidence)
    covariance = evidence.calibration.covariance[: len(amplitudes), : len(amplitudes)]
    sigma = None
    mean_sigma = 0.0
    if covariance.size:
        root = 1e6 * covariance_root(covariance)
        sigma = np.linalg.norm((basis - mean) @ root, axis=-1).reshape(shape)
        mean_sigma = float(np.linalg.norm(mean @ root))
    return Heights(
        x=horizontal * to_x,
        y=vertical * to_y,
        visible=visible.reshape(shape),
        height=1e6 * ((basis - mean) @ amplitudes).reshape(shape),
        sigma=sigma,
        mean=1e6 * float(mean @ amplitudes),
        mean_sigma=mean_sigma,
    )


def _range(values: Array, glass: Heights) -> tuple[float, float]:
    visible = values[glass.visible]
    return float(visible.min()), float(visible.max())

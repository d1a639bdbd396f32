"""The glass surface, and where the corners were."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from calib.plots.style import (
    BLUE,
    FAINT,
    INK,
    ONE_SIDED,
    SERIES,
    TWO_SIDED,
    colour_bar,
    draw_figure,
    image_axes,
    label_lines,
    panel_size,
    side_by_side,
)
from calib.report.chart import ChartPanel, exit_points
from calib.report.coverage import BARS, depth_title, has_chart, image_title
from calib.report.evidence import Array, Evidence
from calib.report.glass import Heights, describe_detail, heights, read_detail

PANEL = (3.9, 3.0)
"""Width and height in inches."""


def glass_figure(evidence: Evidence) -> Figure | None:
    """Return None without a relief."""
    if not evidence.calibration.relief:
        return None
    glass = heights(evidence, evidence.calibration.relief)
    low, high = glass.range(glass.height)
    limit = max(-low, high) or 1.0
    count = 1 if glass.sigma is None else 2

    def paint(figure: Figure) -> None:
        panels = side_by_side(figure, [PANEL[0]] * count, (0.65, 0.95)[:count])
        _glass_field(panels[0], glass, glass.height, TWO_SIDED, (-limit, limit))
        if high > low:
            visible = np.where(glass.visible, glass.height, np.nan)
            lines = panels[0].contour(glass.x, glass.y, visible, 7, colors=[INK], linewidths=0.7)
            label_lines(panels[0], lines, size=8, marks=glass.panel.frame)
        panels[0].set_title(glass.height_title)
        if glass.sigma is not None:
            largest = 2 * float(np.median(glass.sigma[glass.visible]))
            _glass_field(panels[1], glass, glass.sigma, ONE_SIDED, (0, largest), "max")
            exits = glass.panel.place(exit_points(evidence, evidence.pixels))
            panels[1].plot(*exits.T, ".", markersize=1.8, color="#808080")
            panels[1].set_title(glass.sigma_title)
            panels[1].set_ylabel("")

    return draw_figure(PANEL, paint)


def detail_figure(evidence: Evidence) -> Figure | None:
    """Return the outer surface in detail; None where the session has no dense points."""
    camera, provenance = evidence.calibration.camera, evidence.calibration.request.provenance
    session = provenance and provenance.session
    detail = read_detail(evidence.calibration, Path(session)) if session else None
    if not detail:
        return None
    height = 1e6 * detail.height
    title, limit = describe_detail(height)
    panel = panel_size(camera.width / camera.height, PANEL[1])

    def paint(figure: Figure) -> None:
        (axes,) = side_by_side(figure, [panel[0]], (0.65,))
        image_axes(axes, camera.width, camera.height)
        reach = (detail.x[0], detail.x[-1], detail.y[-1], detail.y[0])
        shown = axes.imshow(height, TWO_SIDED, vmin=-limit, vmax=limit, extent=reach)
        axes.set_title(title)
        colour_bar(shown, axes, "µm")

    return draw_figure(panel, paint)


def _glass_field(
    axes: Axes,
    glass: Heights,
    values: Array,
    cmap: Colormap,
    limits: tuple[float, float],
    extend: str = "neither",
) -> None:
    frame = _chart_axes(axes, glass.panel)
    extent = (glass.x[0], glass.x[-1], glass.y[-1], glass.y[0])
    shown = axes.imshow(
        values,
        cmap=cmap,
        vmin=limits[0],
        vmax=limits[1],
        extent=extent,
        aspect="auto",
        interpolation="bilinear",
    )
    shown.set_clip_path(frame)
    colour_bar(shown, axes, "µm", extend)


def _chart_axes(axes: Axes, panel: ChartPanel) -> Polygon:
    """Label the axes, and draw the border of the region that the image sees."""
    frame = Polygon(panel.frame, fill=False, edgecolor=FAINT, linewidth=0.9)
    axes.add_patch(frame)
    low = panel.frame.min(0)
    high = panel.frame.max(0)
    pad = 0.04 * (high - low)
    axes.set(
        xlabel=panel.labels[0],
        ylabel=panel.labels[1],
        xlim=(low[0] - pad[0], high[0] + pad[0]),
        ylim=(high[1] + pad[1], low[1] - pad[1]),
    )
    return frame


def coverage_figure(evidence: Evidence) -> Figure:
    camera, covered = evidence.calibration.camera, has_chart(evidence)
    panel = panel_size(camera.width / camera.height, 2.9 if covered else 4.0)
    counts = np.where(evidence.counts > 0, evidence.counts, np.nan)

    def paint(figure: Figure) -> None:
        free_width = 9.85 - 2.15 - panel[0] - 0.65 * covered
        image_panel, depth_panel, *glass_panels = side_by_side(
            figure,
            (panel[0], *[free_width / (1 + covered)] * (1 + covered)),
            (0.65, 1.3, 0.65)[: 2 + covered],
        )
        image_axes(image_panel, camera.width, camera.height)
        extent = (*image_panel.get_xlim(), *image_panel.get_ylim())
        shown = image_panel.imshow(counts, cmap=ONE_SIDED, vmin=0, extent=extent)
        image_panel.plot(*evidence.pixels.T, ".", markersize=1.2, color="#808080", alpha=0.6)
        image_panel.set_title(image_title(evidence))
        colour_bar(shown, image_panel, "corners")
        depth_panel.hist(evidence.distance, BARS, color=SERIES[0], rwidth=0.88)
        name = f"{evidence.distance_name} (m)"
        depth_panel.set(xlabel=name, ylabel="corners", title=depth_title(evidence))
        for axes in glass_panels:
            chart = ChartPanel.of(evidence)
            _chart_axes(axes, chart)
            exits = chart.place(exit_points(evidence, evidence.pixels))
            axes.plot(*exits.T, ".", markersize=2.2, color=BLUE, alpha=0.6)
            axes.set_title("glass: where the rays leave it")

    return draw_figure(panel, paint)

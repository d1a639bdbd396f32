"""Figure: the corners in the image, their depths, and their exit points on the glass.

Elsewhere the model extrapolates.
"""

import numpy as np
from matplotlib.figure import Figure

from calib.report.chart import chart_axes, chart_to_panel, exit_points
from calib.report.evidence import Evidence
from calib.report.figure import Drawing
from calib.report.ink import (
    BLUE,
    ONE_SIDED,
    SERIES,
    colour_bar,
    draw_svg,
    image_axes,
    panel_size,
    side_by_side,
)

BARS = 16


def corner_coverage(evidence: Evidence) -> Drawing:
    camera = evidence.calibration.camera
    covered = (
        evidence.calibration.cover.shape != "none"
    )  # a window that only the diagnosis knows has no chart
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
        shown = image_panel.imshow(
            counts,
            cmap=ONE_SIDED,
            vmin=0,
            extent=(*image_panel.get_xlim(), *image_panel.get_ylim()),
            interpolation="nearest",
        )
        image_panel.plot(
            *evidence.pixels.T, ".", markersize=1.2, color="#808080", alpha=0.6, rasterized=True
        )
        image_panel.set_title(f"image: {100 * evidence.covered:.0f} % of the cells")
        colour_bar(figure, shown, image_panel, "corners")
        near, far = evidence.reach
        depth_panel.hist(evidence.distance, BARS, color=SERIES[0], rwidth=0.88)
        name = evidence.distance_name
        title = f"{name}: {near:.2g} to {far:.2g} m"
        depth_panel.set(xlabel=f"{name} (m)", ylabel="corners", title=title)
        for axes in glass_panels:
            chart_axes(axes, evidence)
            axes.plot(
                *chart_to_panel(evidence, exit_points(evidence, evidence.pixels)),
                ".",
                markersize=2.2,
                color=BLUE,
                alpha=0.6,
                rasterized=True,
            )
            axes.set_title("glass: where the rays leave it")

    return Drawing(
        "coverage",
        "Where the corners were",
        draw_svg("coverage", panel, paint),
        "Empty cells hold no corner: there the model is extrapolated from its neighbours."
        + (" The frame on the glass is the image's border." if covered else ""),
    )

"""Where the corners were: in the image, at which depths, behind which part of the glass.

Elsewhere the model extrapolates.
"""

import numpy as np
from matplotlib.figure import Figure

from calib.report.chart import chart_axes, drawn, hits
from calib.report.evidence import Evidence
from calib.report.figure import Drawing
from calib.report.ink import BLUE, MORE, SERIES, colour_bar, draw, fitted, image_axes, side_by_side

BARS = 16


def coverage(evidence: Evidence) -> Drawing:
    camera = evidence.calibration.camera
    covered = (
        evidence.calibration.cover.shape != "none"
    )  # a window that only the diagnosis knows has no chart
    panel = fitted(camera.width / camera.height, 2.9 if covered else 4.0)
    counts = np.where(evidence.counts > 0, evidence.counts, np.nan)

    def paint(figure: Figure) -> None:
        rest = 9.85 - 2.15 - panel[0] - 0.65 * covered
        left, centre, *right = side_by_side(
            figure,
            (panel[0], *[rest / (1 + covered)] * (1 + covered)),
            (0.65, 1.3, 0.65)[: 2 + covered],
        )
        image_axes(left, camera.width, camera.height)
        shown = left.imshow(
            counts,
            cmap=MORE,
            vmin=0,
            extent=(*left.get_xlim(), *left.get_ylim()),
            interpolation="nearest",
        )
        left.plot(
            *evidence.pixels.T, ".", markersize=1.2, color="#808080", alpha=0.6, rasterized=True
        )
        left.set_title(f"image: {100 * evidence.covered:.0f} % of the cells")
        colour_bar(figure, shown, left, "corners")
        near, far = evidence.reach
        centre.hist(evidence.distance, BARS, color=SERIES[0], rwidth=0.88)
        name = evidence.distance_name
        title = f"{name}: {near:.2g} to {far:.2g} m"
        centre.set(xlabel=f"{name} (m)", ylabel="corners", title=title)
        for axes in right:
            chart_axes(axes, evidence)
            axes.plot(
                *drawn(evidence, hits(evidence, evidence.pixels)),
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
        draw("coverage", panel, paint),
        "Empty cells hold no corner: there the model is extrapolated from its neighbours."
        + (" The frame on the glass is the image's border." if covered else ""),
    )

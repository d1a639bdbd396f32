"""Figure: the predicted standard deviation of the maps, at several depths."""

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from calib.report.evidence import Evidence
from calib.report.figure import Drawing
from calib.report.ink import (
    INK,
    ONE_SIDED,
    colour_bar,
    draw_svg,
    image_axes,
    label_lines,
    panel_size,
    side_by_side,
)


def predicted_errors(evidence: Evidence) -> Drawing | None:
    """Return None if the fit estimated no covariance."""
    field = evidence.sigma
    if not field:
        return None
    camera, depths = evidence.calibration.camera, evidence.depths[:3]
    sigmas = [evidence.sigma_at_nodes(depth) for depth in depths]
    panel = panel_size(camera.width / camera.height, 2.7 if len(depths) > 2 else 4.0)
    limit = max(float(np.nanquantile(sigma, 0.98)) for sigma in sigmas)

    def paint(figure: Figure) -> None:
        panels = side_by_side(figure, [panel[0]] * len(depths), (0.65, 0.25, 0.25)[: len(depths)])
        for axes, depth, sigma in zip(panels, depths, sigmas, strict=True):
            image_axes(axes, camera.width, camera.height)
            shown = axes.imshow(
                sigma,
                cmap=ONE_SIDED,
                norm=Normalize(0, limit),
                extent=(*axes.get_xlim(), *axes.get_ylim()),
            )
            axes.plot(
                *evidence.pixels.T, ".", markersize=1, color="#808080", alpha=0.5, rasterized=True
            )
            levels = np.unique(np.nanquantile(sigma, (0.25, 0.5, 0.75, 0.95)).round(3))
            lines = axes.contour(
                field.nodes_x, field.nodes_y, sigma, levels, colors=[INK], linewidths=0.8
            )
            label_lines(axes, lines, "%.3g", 8)
            axes.set_title(
                f"at {depth:g} m: {np.nanmedian(evidence.sigma_at_corners(depth)):.2g} px at the"
                " corners"
            )
        for axes in panels[1:]:
            axes.set(ylabel="", yticklabels=[])
        colour_bar(figure, shown, panels[-1], "px", extend="max")

    return Drawing(
        "sigma",
        "Uncertainty of the maps",
        draw_svg("sigma", panel, paint),
        "Predicted standard deviation of the undistorted position, x and y together, if the model"
        " is right. It follows from the corners' noise and the prior on the glass. It excludes the"
        " rigid motion of all rays, which no view of a board fixes. Dots: corners. The titles give"
        " the median over them." + evidence.limit_caption,
    )

"""Figure: the distortion over the image, with contours (the paper's Fig. 7)."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.report.displacement import lattice
from calib.report.evidence import Evidence
from calib.report.figure import Drawing
from calib.report.ink import (
    FAINT,
    INK,
    ONE_SIDED,
    colour_bar,
    draw_svg,
    image_axes,
    label_lines,
    panel_size,
    side_by_side,
)

NODES = (65, 49)
ARROWS = (15, 11)
LEVELS = (0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 25.0, 50.0, 100.0, 250.0, 500.0)
"""Contours in px; 2.5, 5 and 10 are those of the paper."""
MAX_LEVELS = 4


def distortion_fields(evidence: Evidence) -> Drawing:
    camera, depends_on_depth = evidence.calibration.camera, not evidence.path.central
    depths = (
        list(dict.fromkeys((evidence.depths[0], evidence.depths[-1])))
        if depends_on_depth
        else [1.0]
    )
    x, y, displacement = lattice(evidence, NODES)
    sizes = [np.linalg.norm(displacement.at(depth), axis=-1) for depth in depths]
    largest = max(float(np.nanmax(size)) for size in sizes)
    levels = [level for level in LEVELS if level < largest][-MAX_LEVELS:]
    panel = panel_size(camera.width / camera.height, 4.2)

    def paint(figure: Figure) -> None:
        panels = side_by_side(figure, [panel[0]] * len(depths), (0.65, 0.25)[: len(depths)])
        for axes, depth, size in zip(panels, depths, sizes, strict=True):
            image_axes(axes, camera.width, camera.height)
            shown = axes.imshow(
                size,
                cmap=ONE_SIDED,
                vmin=0,
                vmax=largest,
                extent=(*axes.get_xlim(), *axes.get_ylim()),
            )
            if levels:
                lines = axes.contour(x, y, size, levels, colors=[INK], linewidths=0.9)
                label_lines(axes, lines, "%g px")
            _arrows(axes, evidence, depth)
            where = f"at {depth:g} m" if depends_on_depth else "at every depth"
            axes.set_title(f"{where}: {np.nanmin(size):.1f} to {np.nanmax(size):.1f} px")
        for axes in panels[1:]:
            axes.set(ylabel="", yticklabels=[])
        colour_bar(figure, shown, panels[-1], "px")

    return Drawing(
        "distortion",
        "The distortion over the image",
        draw_svg("distortion", panel, paint),
        "Undistorted minus distorted pixel, for a scene at one depth. Contours are lines of"
        " equal length; arrows show the direction, scaled so that the longest has the same size in"
        " every panel."
        + (
            " The panels differ because the cover shifts rays as well as bending them."
            if len(depths) == 2
            else ""
        )
        + evidence.limit_caption,
    )


def _arrows(axes: Axes, evidence: Evidence, depth: float) -> None:
    x, y, displacement = lattice(evidence, (2 * ARROWS[0] + 1, 2 * ARROWS[1] + 1))
    field = displacement.at(depth)[1::2, 1::2]
    longest = float(np.nanmax(np.linalg.norm(field, axis=-1)))
    scale = max(longest, 1e-9) * ARROWS[0] / (1.1 * evidence.calibration.camera.width)
    axes.quiver(
        x[1::2],
        y[1::2],
        field[..., 0],
        field[..., 1],
        angles="xy",
        scale_units="xy",
        scale=scale,
        width=0.003,
        color=FAINT,
    )

"""The distortion over the image, with contours: the paper's Fig. 7."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.report.displacement import lattice
from calib.report.evidence import Evidence
from calib.report.figure import Drawing
from calib.report.ink import (
    FAINT,
    INK,
    MORE,
    colour_bar,
    draw,
    fitted,
    image_axes,
    label_lines,
    side_by_side,
)

NODES = (65, 49)
ARROWS = (15, 11)
LEVELS = (0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 25.0, 50.0, 100.0, 250.0, 500.0)
"""px; three of them are the paper's."""
MOST_LEVELS = 4


def distortion_fields(evidence: Evidence) -> Drawing:
    camera, moves = evidence.calibration.camera, not evidence.path.central
    wide = evidence.path.lens.wide
    depths = list(dict.fromkeys((evidence.depths[0], evidence.depths[-1]))) if moves else [1.0]
    x, y, displacement = lattice(evidence, NODES)
    sizes = [np.linalg.norm(displacement.at(depth), axis=-1) for depth in depths]
    most = max(float(np.nanmax(size)) for size in sizes)
    levels = [level for level in LEVELS if level < most][-MOST_LEVELS:]
    panel = fitted(camera.width / camera.height, 4.2)

    def paint(figure: Figure) -> None:
        panels = side_by_side(figure, [panel[0]] * len(depths), (0.65, 0.25)[: len(depths)])
        for axes, depth, size in zip(panels, depths, sizes, strict=True):
            image_axes(axes, camera.width, camera.height)
            shown = axes.imshow(
                size, cmap=MORE, vmin=0, vmax=most, extent=(*axes.get_xlim(), *axes.get_ylim())
            )
            if levels:
                lines = axes.contour(x, y, size, levels, colors=[INK], linewidths=0.9)
                label_lines(axes, lines, "%g px")
            _arrows(axes, evidence, depth)
            where = f"at {depth:g} m" if moves else "at every depth"
            axes.set_title(f"{where}: {np.nanmin(size):.1f} to {np.nanmax(size):.1f} px")
        for other in panels[1:]:
            other.set(ylabel="", yticklabels=[])
        colour_bar(figure, shown, panels[-1], "px")

    return Drawing(
        "distortion",
        "The distortion over the image",
        draw("distortion", panel, paint),
        "Undistorted minus distorted pixel, for a scene at one depth. Lines join equal lengths;"
        " arrows show the direction, each panel's longest drawn equally long."
        + (
            " The panels differ because rays are shifted as well as turned."
            if len(depths) == 2
            else ""
        )
        + (" Empty: what this camera's undistorted picture does not show." if wide else ""),
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

"""Figure: distortion against inverse depth (the paper's Fig. 8), and its slope over the image."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.report.displacement import Displacement, lattice
from calib.report.evidence import Array, Evidence
from calib.report.figure import Drawing
from calib.report.ink import (
    FAINT,
    INK,
    ONE_SIDED,
    SERIES,
    colour_bar,
    draw_svg,
    grid_lines,
    image_axes,
    label_lines,
    panel_size,
    side_by_side,
)

NODES = (65, 49)
REACH = (0.5, 10.0)
"""The range of the paper's Fig. 8 in 1/m; the training depths may extend it."""
CHOSEN = {"●": (0.5, 0.5), "■": (0.25, 0.5), "▲": (0.125, 0.5), "◆": (0.02, 0.02)}
"""Marks of the four pixels whose lines are drawn, as fractions of the image: the centre, the two of
the paper, and a corner.
"""
CONTOURS = 5


def distortion_by_depth(evidence: Evidence) -> Drawing | None:
    """Return None for a central camera, whose distortion does not depend on depth."""
    if evidence.path.central:
        return None
    camera = evidence.calibration.camera
    pixels = np.array(list(CHOSEN.values())) * [camera.width - 1, camera.height - 1]
    x, y, displacement = lattice(evidence, NODES)
    change = np.linalg.norm(displacement.parallax, axis=-1)
    panel = panel_size(camera.width / camera.height, 4.1)

    def paint(figure: Figure) -> None:
        line_panel, map_panel = side_by_side(figure, (9.3 - 1.35 - panel[0], panel[0]), (0.65, 0.7))
        _lines(line_panel, evidence, pixels, displacement)
        image_axes(map_panel, camera.width, camera.height)
        shown = map_panel.imshow(
            change, cmap=ONE_SIDED, vmin=0, extent=(*map_panel.get_xlim(), *map_panel.get_ylim())
        )
        label_lines(
            map_panel,
            map_panel.contour(x, y, change, CONTOURS, colors=[INK], linewidths=0.9),
            marks=pixels,
        )
        for mark, (column, row), colour in zip(CHOSEN, pixels, SERIES, strict=False):
            map_panel.text(column, row, mark, color=colour, ha="center", va="center", fontsize=11)
        map_panel.set_title("change per inverse depth, px per 1/m")
        colour_bar(figure, shown, map_panel, "px m")

    return Drawing(
        "by-depth",
        "The distortion by inverse depth",
        draw_svg("by-depth", panel, paint),
        "Left: the length of the distortion at four pixels, which the right panel marks, and its"
        " mean; the numbers are the change over the whole axis. The x and y components are exact"
        " straight lines. Shaded: the depths of the corners. Right: how far the undistorted pixel"
        " moves when 1/depth changes by one. Where this is large, a map needs the right depth.",
    )


def _lines(axes: Axes, evidence: Evidence, pixels: Array, displacement: Displacement) -> None:
    near, far = evidence.reach
    inverse = np.linspace(min(REACH[0], 1 / far), max(REACH[1], 1 / near), 60)
    chosen = Displacement.of(evidence, pixels)
    lengths = np.array(
        [np.linalg.norm(chosen.at(1 / inverse_depth), axis=-1) for inverse_depth in inverse]
    )
    mean = np.array(
        [
            np.nanmean(np.linalg.norm(displacement.at(1 / inverse_depth), axis=-1))
            for inverse_depth in inverse
        ]
    )
    axes.axvspan(1 / far, 1 / near, color=FAINT, alpha=0.15, linewidth=0, label="trained")
    for mark, length, (column, row), colour in zip(CHOSEN, lengths.T, pixels, SERIES, strict=False):
        if not np.isfinite(length).all():
            continue  # the undistorted picture does not hold this pixel
        label = f"{mark} ({column:.0f}, {row:.0f}): {length[-1] - length[0]:+.2f} px"
        axes.plot(inverse, length, color=colour, linewidth=1.8, label=label)
    axes.plot(
        inverse,
        mean,
        color=INK,
        linewidth=1.8,
        linestyle=(0, (4, 2)),
        label=f"mean: {mean[-1] - mean[0]:+.2f} px",
    )
    axes.set(xlabel="inverse depth (1/m)", ylabel="distortion (px)", xlim=(inverse[0], inverse[-1]))
    axes.set_ylim(0, 1.45 * max(np.nanmax(lengths), mean.max()))
    grid_lines(axes)
    axes.legend(loc="upper left", ncols=2, columnspacing=0.8, handlelength=1.4, handletextpad=0.4)

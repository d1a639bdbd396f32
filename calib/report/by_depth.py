"""The distortion against inverse depth, the paper's Fig. 8, and where in the image depth
matters.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.report.displacement import Displacement, lattice
from calib.report.evidence import Array, Evidence
from calib.report.figure import Drawing
from calib.report.ink import (
    FAINT,
    INK,
    MORE,
    SERIES,
    colour_bar,
    draw,
    fitted,
    grid_lines,
    image_axes,
    label_lines,
    side_by_side,
)

NODES = (65, 49)
REACH = (0.5, 10.0)
"""1/m, of the paper's Fig. 8; widened to the training depths."""
CHOSEN = {"●": (0.5, 0.5), "■": (0.25, 0.5), "▲": (0.125, 0.5), "◆": (0.02, 0.02)}
"""The pixels whose lines are drawn, as parts of the image, by their marks: the centre, the paper's
two, a corner.
"""
CONTOURS = 5


def distortion_by_depth(evidence: Evidence) -> Drawing | None:
    """None of a central camera, whose distortion is the same at every depth."""
    if evidence.path.central:
        return None
    camera = evidence.calibration.camera
    pixels = np.array(list(CHOSEN.values())) * [camera.width - 1, camera.height - 1]
    x, y, everywhere = lattice(evidence, NODES)
    change = np.linalg.norm(everywhere.parallax, axis=-1)
    panel = fitted(camera.width / camera.height, 4.1)

    def paint(figure: Figure) -> None:
        left, right = side_by_side(figure, (9.3 - 1.35 - panel[0], panel[0]), (0.65, 0.7))
        _lines(left, evidence, pixels, everywhere)
        image_axes(right, camera.width, camera.height)
        shown = right.imshow(
            change, cmap=MORE, vmin=0, extent=(*right.get_xlim(), *right.get_ylim())
        )
        label_lines(
            right, right.contour(x, y, change, CONTOURS, colors=[INK], linewidths=0.9), marks=pixels
        )
        for mark, (column, row), colour in zip(CHOSEN, pixels, SERIES, strict=False):
            right.text(column, row, mark, color=colour, ha="center", va="center", fontsize=11)
        right.set_title("what depth moves, px for each 1/m")
        colour_bar(figure, shown, right, "px m")

    return Drawing(
        "by-depth",
        "The distortion by inverse depth",
        draw("by-depth", panel, paint),
        "Left: its length at four pixels, marked on the right, and on average; the numbers say how"
        " much it changes over the axis. Along x and y the change is exactly a straight line."
        " Shaded: depths at which there were corners. Right: how far each pixel's undistorted place"
        " moves when 1/depth changes by one: where it is much, a map needs the right depth.",
    )


def _lines(axes: Axes, evidence: Evidence, pixels: Array, everywhere: Displacement) -> None:
    near, far = evidence.reach
    inverse = np.linspace(min(REACH[0], 1 / far), max(REACH[1], 1 / near), 60)
    own = Displacement.of(evidence, pixels)
    lengths = np.array([np.linalg.norm(own.at(1 / each), axis=-1) for each in inverse])
    mean = np.array(
        [np.nanmean(np.linalg.norm(everywhere.at(1 / each), axis=-1)) for each in inverse]
    )
    axes.axvspan(1 / far, 1 / near, color=FAINT, alpha=0.15, linewidth=0, label="trained")
    for mark, length, (column, row), colour in zip(CHOSEN, lengths.T, pixels, SERIES, strict=False):
        if not np.isfinite(length).all():
            continue  # no undistorted picture holds it
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

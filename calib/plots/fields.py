"""Fields over the image: the distortion, its change with depth, and the maps' uncertainty."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from calib.apply.map_uncertainty import map_sigmas
from calib.plots.style import (
    FAINT,
    INK,
    ONE_SIDED,
    SERIES,
    colour_bar,
    draw_figure,
    image_axes,
    label_lines,
    panel_size,
    side_by_side,
)
from calib.report.by_depth import CHOSEN, chosen_pixels, inverse_depths, lengths_by_depth
from calib.report.displacement import Displacement, lattice
from calib.report.distortion import NODES, contour_levels, shown_depths
from calib.report.evidence import Array, Evidence
from calib.report.sigma import MAX_PANELS
from calib.rounding import two_digits

ARROWS = (15, 11)
CONTOURS = 5


def distortion_figure(evidence: Evidence) -> Figure:
    camera, depths = evidence.calibration.camera, shown_depths(evidence)
    _, _, displacement = lattice(evidence, NODES)
    largest = max(float(np.nanmax(_lengths(displacement, depth))) for depth in depths)
    panel = panel_size(camera.width / camera.height, 4.2)

    def paint(figure: Figure) -> None:
        panels = side_by_side(figure, [panel[0]] * len(depths), (0.65, 0.25)[: len(depths)])
        for axes, depth in zip(panels, depths, strict=True):
            shown = distortion_field(axes, evidence, depth, largest)
        for axes in panels[1:]:
            axes.set(ylabel="", yticklabels=[])
        colour_bar(shown, panels[-1], "px")

    return draw_figure(panel, paint)


def distortion_field(
    axes: Axes, evidence: Evidence, depth: float, largest: float | None = None
) -> ScalarMappable:
    """Draw the distortion at a depth in m; `largest` px has the strongest colour."""
    camera = evidence.calibration.camera
    x, y, displacement = lattice(evidence, NODES)
    size = _lengths(displacement, depth)
    largest = largest or float(np.nanmax(size))
    image_axes(axes, camera.width, camera.height)
    shown = _field(axes, size, largest)
    if levels := contour_levels(largest):
        lines = axes.contour(x, y, size, levels, colors=[INK], linewidths=0.9)
        label_lines(axes, lines, "%g px")
    _direction(axes, evidence, depth)
    where = "at every depth" if evidence.path.central else f"at {depth:g} m"
    axes.set_title(f"{where}: {np.nanmin(size):.1f} to {np.nanmax(size):.1f} px")
    return shown


def _lengths(displacement: Displacement, depth: float) -> Array:
    return np.asarray(np.linalg.norm(displacement.at(depth), axis=-1))


def _field(axes: Axes, values: Array, largest: float) -> ScalarMappable:
    extent = (*axes.get_xlim(), *axes.get_ylim())
    shown: ScalarMappable = axes.imshow(
        values, cmap=ONE_SIDED, vmin=0, vmax=largest, extent=extent, interpolation="bilinear"
    )
    return shown


def _direction(axes: Axes, evidence: Evidence, depth: float) -> None:
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


def depth_figure(evidence: Evidence) -> Figure | None:
    """Return None for a central camera, whose distortion does not depend on depth."""
    if evidence.path.central:
        return None
    camera, pixels = evidence.calibration.camera, chosen_pixels(evidence)
    x, y, displacement = lattice(evidence, NODES)
    change = np.linalg.norm(displacement.parallax, axis=-1)
    panel = panel_size(camera.width / camera.height, 4.1)

    def paint(figure: Figure) -> None:
        line_panel, map_panel = side_by_side(figure, (9.3 - 1.35 - panel[0], panel[0]), (0.65, 0.7))
        _lines(line_panel, evidence, pixels, displacement)
        image_axes(map_panel, camera.width, camera.height)
        shown = _field(map_panel, change, float(np.nanmax(change)))
        lines = map_panel.contour(x, y, change, CONTOURS, colors=[INK], linewidths=0.9)
        label_lines(map_panel, lines, marks=pixels)
        for mark, (column, row), colour in zip(CHOSEN, pixels, SERIES, strict=False):
            map_panel.text(column, row, mark, color=colour, ha="center", va="center", fontsize=11)
        map_panel.set_title("change per inverse depth, px per 1/m")
        colour_bar(shown, map_panel, "px m")

    return draw_figure(panel, paint)


def _lines(axes: Axes, evidence: Evidence, pixels: Array, displacement: Displacement) -> None:
    near, far = evidence.reach
    inverse = inverse_depths(evidence)
    lengths = lengths_by_depth(Displacement.of(evidence, pixels), inverse)
    mean = np.nanmean(lengths_by_depth(displacement, inverse), (1, 2))
    axes.axvspan(1 / far, 1 / near, color=FAINT, alpha=0.15, linewidth=0, label="trained")
    for mark, length, (column, row), colour in zip(CHOSEN, lengths.T, pixels, SERIES, strict=False):
        if not np.isfinite(length).all():
            continue  # the undistorted picture does not hold this pixel
        label = f"{mark} ({column:.0f}, {row:.0f}): {length[-1] - length[0]:+.2f} px"
        axes.plot(inverse, length, color=colour, linewidth=1.8, label=label)
    label = f"mean: {mean[-1] - mean[0]:+.2f} px"
    axes.plot(inverse, mean, color=INK, linewidth=1.8, linestyle="--", label=label)
    axes.set(xlabel="inverse depth (1/m)", ylabel="distortion (px)", xlim=(inverse[0], inverse[-1]))
    axes.set_ylim(0, 1.45 * max(np.nanmax(lengths), mean.max()))
    axes.grid(color=FAINT, alpha=0.35, linewidth=0.6)
    axes.legend(loc="upper left", ncols=2, columnspacing=0.8, handlelength=1.4, handletextpad=0.4)


def sigma_figure(evidence: Evidence) -> Figure | None:
    """Return None if the fit estimated no covariance."""
    field = evidence.sigma
    if not field:
        return None
    camera, depths = evidence.calibration.camera, evidence.depths[:MAX_PANELS]
    sigmas = [evidence.sigma_at_nodes(depth) for depth in depths]
    medians = map_sigmas(evidence.calibration, depths)
    panel = panel_size(camera.width / camera.height, 2.7 if len(depths) > 2 else 4.0)
    limit = max(float(np.nanquantile(sigma, 0.98)) for sigma in sigmas)

    def paint(figure: Figure) -> None:
        panels = side_by_side(figure, [panel[0]] * len(depths), (0.65, 0.25, 0.25)[: len(depths)])
        for axes, depth, sigma in zip(panels, depths, sigmas, strict=True):
            image_axes(axes, camera.width, camera.height)
            shown = _field(axes, sigma, limit)
            axes.plot(*evidence.pixels.T, ".", markersize=1, color="#808080", alpha=0.5)
            levels = np.unique(np.nanquantile(sigma, (0.25, 0.5, 0.75, 0.95)).round(3))
            lines = axes.contour(
                field.nodes_x, field.nodes_y, sigma, levels, colors=[INK], linewidths=0.8
            )
            label_lines(axes, lines, "%.3g", 8)
            axes.set_title(f"at {depth:g} m: {two_digits(medians[depth])} px at the corners")
        for axes in panels[1:]:
            axes.set(ylabel="", yticklabels=[])
        colour_bar(shown, panels[-1], "px", extend="max")

    return draw_figure(panel, paint)

"""The residuals over the image, over the board, by depth, as a distribution, and on the board."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.fitting.corner_range import CELLS
from calib.plots.style import (
    BLUE,
    FAINT,
    INK,
    SERIES,
    VIEW_ERRORS,
    draw_figure,
    image_axes,
    panel_size,
    side_by_side,
)
from calib.report.board_errors import error_panels
from calib.report.corners import relative_errors
from calib.report.evidence import Evidence
from calib.report.residual_maps import (
    Arrows,
    arrows_over_board,
    arrows_over_image,
    depth_bands,
    highest_length,
    typical_length,
)

BINS = 41
SIDE = 2.6
"""The width of a panel that is not one of the image, in inches."""


def residual_figure(evidence: Evidence) -> Figure:
    camera = evidence.calibration.camera
    panel = panel_size(camera.width / camera.height, 3.05)

    def paint(figure: Figure) -> None:
        image, board, depth, distribution = side_by_side(
            figure, (panel[0], panel[1], SIDE, SIDE), (0.65, 0.65, 0.65, 0.65)
        )
        draw_over_image(image, evidence)
        draw_over_board(board, evidence)
        by_distance(depth, evidence)
        histogram(distribution, evidence)

    return draw_figure(panel, paint, width=sum(panel) + 2 * SIDE + 4 * 0.65 + 0.15)


def draw_over_image(axes: Axes, evidence: Evidence) -> None:
    """Draw the mean residuals of the cells of the image."""
    camera, arrows = evidence.calibration.camera, arrows_over_image(evidence)
    image_axes(axes, camera.width, camera.height)
    _arrows(axes, arrows, typical_length(arrows) / (1.1 * camera.width / CELLS[0]))
    axes.set_title(arrows.title)


def draw_over_board(axes: Axes, evidence: Evidence) -> None:
    """Draw the mean residuals of the corners of the board."""
    board, arrows = evidence.calibration.board, arrows_over_board(evidence)
    span = 1e3 * (max(board.half) + board.square)
    axes.set(
        xlim=(-span, span), ylim=(span, -span), xlabel="x (mm)", ylabel="y (mm)", aspect="equal"
    )
    cell = 2.2 * span / max(board.across, 8)
    _arrows(axes, arrows, typical_length(arrows) / cell)
    axes.set_title(arrows.title)


def _arrows(axes: Axes, arrows: Arrows, scale: float) -> None:
    """Draw means as arrows; `scale` is px per unit of the axes."""
    means = arrows.means
    for chosen, colour, width in (
        (~means.significant, FAINT, 0.004),
        (means.significant, SERIES[1], 0.006),
    ):
        shown = chosen & np.isfinite(means.length)
        axes.quiver(
            *arrows.places[shown].T,
            *means.mean[shown].T,
            angles="xy",
            scale_units="xy",
            scale=scale,
            width=width,
            color=colour,
            pivot="mid",
        )


def by_distance(axes: Axes, evidence: Evidence) -> None:
    lengths = np.linalg.norm(evidence.errors, axis=-1)
    bands = depth_bands(evidence)
    axes.plot(evidence.distance, lengths, ".", markersize=2, color=BLUE, alpha=0.35)
    axes.fill_between(bands.middle, bands.low, bands.high, color=SERIES[1], alpha=0.25, linewidth=0)
    axes.plot(bands.middle, bands.rms, color=SERIES[1], linewidth=1.8, label="RMS; 68 % band")
    noise = evidence.calibration.noise_px
    if noise is not None:
        axes.axhline(noise, color=INK, linewidth=0.9, linestyle="--", label="the corners' noise")
    axes.set(
        xlabel=f"{evidence.distance_name} (m)",
        ylabel="error (px)",
        ylim=(0, highest_length(evidence)),
        title=f"by {evidence.distance_name}",
    )
    axes.legend(loc="upper left")


def histogram(axes: Axes, evidence: Evidence) -> None:
    """Draw the distribution of the x and y of all errors, and that of the noise alone."""
    values = evidence.errors[np.isfinite(evidence.errors)]
    limit = 1.1 * float(np.quantile(np.abs(values), 0.996)) or 1.0
    edges = np.linspace(-limit, limit, BINS + 1)
    axes.hist(values, edges.tolist(), color=SERIES[0], alpha=0.7, rwidth=0.9)
    if noise := evidence.calibration.noise_px:
        sigma = noise / np.sqrt(2)  # noise_px is that of x and y together
        x = np.linspace(-limit, limit, 200)
        density = np.exp(-0.5 * (x / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
        label = f"noise of {sigma:.2g} px"
        axes.plot(x, len(values) * (edges[1] - edges[0]) * density, color=INK, label=label)
        axes.legend(loc="upper left")
    axes.set(xlabel="error in x or in y (px)", ylabel="number", title="distribution of the errors")


def board_error_figure(evidence: Evidence) -> Figure:
    panels = error_panels(evidence)
    colours = VIEW_ERRORS(relative_errors(evidence)[evidence.view])

    def paint(figure: Figure) -> None:
        for axes, panel in zip(
            side_by_side(figure, [SIDE] * len(panels), [0.65] * len(panels)), panels, strict=True
        ):
            axes.axhline(0, color=FAINT, linewidth=0.6)
            axes.axvline(0, color=FAINT, linewidth=0.6)
            x, y = panel.errors.T
            axes.scatter(x, y, s=5, c=colours, alpha=0.75, linewidths=0)
            axes.set(
                xlim=(-panel.reach, panel.reach),
                ylim=(panel.reach, -panel.reach),
                aspect="equal",
                xlabel="x (mm)",
                title=panel.title,
            )
            axes.locator_params(nbins=4)
        figure.axes[0].set_ylabel("y (mm)")

    return draw_figure((SIDE, SIDE), paint)

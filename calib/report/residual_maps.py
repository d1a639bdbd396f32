"""Figure: residuals averaged over the image and over the board, and by depth."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.fitting.corner_range import CELLS
from calib.report.evidence import Array, Evidence
from calib.report.figure import Drawing
from calib.report.ink import (
    BLUE,
    FAINT,
    INK,
    SERIES,
    draw_svg,
    image_axes,
    panel_size,
    side_by_side,
)
from calib.report.patterns import GroupMeans, over_board, over_image

BANDS = 10
"""The number of depth bands, which hold equally many corners."""


def residual_maps(evidence: Evidence) -> Drawing:
    camera, board = evidence.calibration.camera, evidence.calibration.board
    x = camera.width * (np.arange(CELLS[0]) + 0.5) / CELLS[0] - 0.5
    y = camera.height * (np.arange(CELLS[1]) + 0.5) / CELLS[1] - 0.5
    in_image, on_board = over_image(evidence), over_board(evidence)
    typical = (
        max(float(np.nanquantile(means.length, 0.95)) for means in (in_image, on_board)) or 1e-3
    )
    panel = panel_size(camera.width / camera.height, 3.05)

    def paint(figure: Figure) -> None:
        image_panel, board_panel, depth_panel = side_by_side(
            figure, (panel[0], panel[1], 9.85 - 1.95 - sum(panel)), (0.65, 0.65, 0.65)
        )
        image_axes(image_panel, camera.width, camera.height)
        _arrows(
            image_panel,
            in_image,
            np.stack(np.meshgrid(x, y), -1).reshape(-1, 2),
            typical / (1.1 * camera.width / CELLS[0]),
        )
        image_panel.set_title(f"over the image; longest {np.nanmax(in_image.length):.2g} px")
        span = 1e3 * (max(board.half) + board.square)
        board_panel.set(
            xlim=(-span, span), ylim=(span, -span), xlabel="x (mm)", ylabel="y (mm)", aspect="equal"
        )
        _arrows(
            board_panel,
            on_board,
            1e3 * board.points(),
            typical / (2.2 * span / max(board.columns, board.rows, 8)),
        )
        board_panel.set_title(f"over the board; longest {np.nanmax(on_board.length):.2g} px")
        _by_depth(depth_panel, evidence)

    return Drawing(
        "residuals",
        "Residuals, and where they are",
        draw_svg("residuals", panel, paint),
        "Mean reprojection errors: the corner that the model predicts minus the detected one."
        " Coloured arrows are so long that noise makes one in a hundred: over the image"
        f" {in_image.summary};"
        f" over the board {on_board.summary}. A pattern over the image points to lens or glass, one"
        " over the board to a board that is not flat or not to scale.",
    )


def _arrows(axes: Axes, means: GroupMeans, places: Array, scale: float) -> None:
    """Draw the means as arrows at (G, 2) places; `scale` is px per unit of the axes."""
    for chosen, colour, width in (
        (~means.significant, FAINT, 0.004),
        (means.significant, SERIES[1], 0.006),
    ):
        shown = chosen & np.isfinite(means.length)
        axes.quiver(
            *places[shown].T,
            *means.mean[shown].T,
            angles="xy",
            scale_units="xy",
            scale=scale,
            width=width,
            color=colour,
            pivot="mid",
        )


def _by_depth(axes: Axes, evidence: Evidence) -> None:
    lengths = np.linalg.norm(evidence.errors, axis=-1)
    bands = [
        band
        for band in np.array_split(np.argsort(evidence.distance), BANDS)
        if np.isfinite(lengths[band]).any()
    ]
    middle = [evidence.distance[band].mean() for band in bands]
    low = [np.nanquantile(lengths[band], 0.16) for band in bands]
    high = [np.nanquantile(lengths[band], 0.84) for band in bands]
    axes.plot(
        evidence.distance, lengths, ".", markersize=2, color=BLUE, alpha=0.35, rasterized=True
    )
    axes.fill_between(middle, low, high, color=SERIES[1], alpha=0.25, linewidth=0)
    axes.plot(
        middle,
        [np.sqrt(np.nanmean(lengths[band] ** 2)) for band in bands],
        color=SERIES[1],
        linewidth=1.8,
        label="RMS; 68 % band",
    )
    if evidence.calibration.noise_px is not None:
        axes.axhline(
            evidence.calibration.noise_px,
            color=INK,
            linewidth=0.9,
            linestyle=(0, (4, 2)),
            label="the corners' noise",
        )
    axes.set(
        xlabel=f"{evidence.distance_name} (m)",
        ylabel="error (px)",
        ylim=(0, 1.35 * np.nanquantile(lengths, 0.99) + 1e-9),
        title=f"by {evidence.distance_name}",
    )
    axes.legend(loc="upper left")

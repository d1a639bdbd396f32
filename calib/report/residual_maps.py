"""What the model leaves, averaged by place in the image and on the board, and by depth."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.report.evidence import CELLS, Array, Evidence
from calib.report.figure import Drawing
from calib.report.ink import BLUE, FAINT, INK, SERIES, draw, fitted, image_axes, side_by_side
from calib.report.patterns import Means, over_board, over_image

BANDS = 10
"""Depths, each with as many corners."""


def residual_maps(evidence: Evidence) -> Drawing:
    camera, board = evidence.calibration.camera, evidence.calibration.board
    x, y = (
        size * (np.arange(n) + 0.5) / n - 0.5
        for size, n in zip((camera.width, camera.height), CELLS, strict=True)
    )
    in_image, on_board = over_image(evidence), over_board(evidence)
    typical = (
        max(float(np.nanquantile(means.length, 0.95)) for means in (in_image, on_board)) or 1e-3
    )
    panel = fitted(camera.width / camera.height, 3.05)

    def paint(figure: Figure) -> None:
        left, centre, right = side_by_side(
            figure, (panel[0], panel[1], 9.85 - 1.95 - sum(panel)), (0.65, 0.65, 0.65)
        )
        image_axes(left, camera.width, camera.height)
        _arrows(
            left,
            in_image,
            np.stack(np.meshgrid(x, y), -1).reshape(-1, 2),
            typical / (1.1 * camera.width / CELLS[0]),
        )
        left.set_title(f"over the image; longest {np.nanmax(in_image.length):.2g} px")
        span = 1e3 * (max(board.half) + board.square)
        centre.set(
            xlim=(-span, span), ylim=(span, -span), xlabel="x (mm)", ylabel="y (mm)", aspect="equal"
        )
        _arrows(
            centre,
            on_board,
            1e3 * board.points(),
            typical / (2.2 * span / max(board.columns, board.rows, 8)),
        )
        centre.set_title(f"over the board; longest {np.nanmax(on_board.length):.2g} px")
        _by_depth(right, evidence)

    return Drawing(
        "residuals",
        "What is left, and where",
        draw("residuals", panel, paint),
        "Mean reprojection errors: where the model sees a corner minus where it was seen. Coloured"
        f" arrows are longer than noise makes one in a hundred: over the image {in_image.said};"
        f" over the board {on_board.said}. A pattern over the image speaks of lens or glass, one"
        " over the board of a board that is not flat or not to scale.",
    )


def _arrows(axes: Axes, means: Means, at: Array, scale: float) -> None:
    """Draw the means at (G, 2) places; scale is px for each unit of the axes."""
    for chosen, colour, width in ((~means.beyond, FAINT, 0.004), (means.beyond, SERIES[1], 0.006)):
        some = chosen & np.isfinite(means.length)
        axes.quiver(
            *at[some].T,
            *means.mean[some].T,
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
    low, high = (
        np.array([np.nanquantile(lengths[band], part) for band in bands]) for part in (0.16, 0.84)
    )
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

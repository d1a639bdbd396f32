"""The outer surface of the cover: how uneven it is, how sure that is, and where the corners were
seen through it.
"""

from dataclasses import dataclass

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.path import Path
from numpy.typing import NDArray

from calib.apply.map_uncertainty import root_of
from calib.optics.relief import Relief
from calib.report.chart import border, chart_axes, drawn, hits, units
from calib.report.evidence import Array, Evidence
from calib.report.figure import Drawing
from calib.report.ink import BELOW_AND_ABOVE, INK, MORE, colour_bar, draw, label_lines, side_by_side

NODES = (81, 61)
"""Of the chart, across and down."""
PANEL = (3.9, 3.0)
"""Inches"""


@dataclass(frozen=True, slots=True)
class Heights:
    """The relief over the chart, less its mean where the image sees it."""

    across: Array
    """(w,) as drawn."""
    down: Array
    """(h,)"""
    seen: NDArray[np.bool_]
    """(h, w) whether the image sees it."""
    height: Array
    """(h, w) um"""
    sigma: Array | None
    """(h, w) um; None where the fit estimated no covariance."""
    mean: float
    """um"""
    mean_sigma: float


def glass_surface(evidence: Evidence) -> Drawing | None:
    """None without a relief."""
    relief = evidence.calibration.relief
    if not relief:
        return None
    glass = _heights(evidence, relief)
    low, high = _range(glass.height, glass)
    most = max(-low, high) or 1.0

    def field(
        figure: Figure,
        axes: Axes,
        values: Array,
        cmap: Colormap,
        limits: tuple[float, float],
        extend: str,
    ) -> Polygon:
        frame = chart_axes(axes, evidence)
        extent = (glass.across[0], glass.across[-1], glass.down[-1], glass.down[0])
        shown = axes.imshow(
            values, cmap=cmap, vmin=limits[0], vmax=limits[1], extent=extent, aspect="auto"
        )
        shown.set_clip_path(frame)
        colour_bar(figure, shown, axes, "µm", extend)
        return frame

    def paint(figure: Figure) -> None:
        panels = side_by_side(
            figure,
            [PANEL[0]] * (1 if glass.sigma is None else 2),
            (0.65, 0.95)[: 1 if glass.sigma is None else 2],
        )
        frame = field(figure, panels[0], glass.height, BELOW_AND_ABOVE, (-most, most), "neither")
        if high > low:
            lines = panels[0].contour(
                glass.across,
                glass.down,
                np.where(glass.seen, glass.height, np.nan),
                7,
                colors=[INK],
                linewidths=0.7,
            )
            label_lines(panels[0], lines, size=8, marks=frame.get_xy())
        panels[0].set_title(f"height: {low:+.2g} to {high:+.2g} µm")
        if glass.sigma is not None:
            field(
                figure,
                panels[1],
                glass.sigma,
                MORE,
                (0, 2 * float(np.median(glass.sigma[glass.seen]))),
                "max",
            )
            panels[1].plot(
                *drawn(evidence, hits(evidence, evidence.pixels)),
                ".",
                markersize=1.8,
                color="#808080",
                rasterized=True,
            )
            least, largest = _range(glass.sigma, glass)
            panels[1].set_title(f"its standard deviation: {least:.2g} to {largest:.2g} µm")
            panels[1].set_ylabel("")

    mean = f"{round(glass.mean, 1) + 0.0}" + (
        "" if glass.sigma is None else f" ± {glass.mean_sigma:.1f}"
    )
    caption = (
        f"The relief of the outer surface where the image sees it, less its mean of {mean} µm: an"
        " even layer bends light hardly at all, so it is known less well than what is uneven."
    )
    if glass.sigma is not None:
        caption += (
            " Dots: where the corners' rays leave the glass. Away from them, the prior speaks."
        )
    return Drawing("glass", "The glass surface", draw("glass", PANEL, paint), caption)


def _heights(evidence: Evidence, relief: Relief) -> Heights:
    edge = border(evidence)
    low, high = edge.min(0), edge.max(0)
    second, first = (
        np.linspace(low[axis], high[axis], n) for axis, n in zip((1, 0), NODES, strict=True)
    )
    inside = Path(edge).contains_points(
        np.stack(np.meshgrid(first, second, indexing="ij"), -1).reshape(-1, 2)
    )
    one, two = (
        relief.gaussians(torch.from_numpy(c), axis)[0].numpy()
        for axis, c in enumerate((first, second))
    )
    basis = np.einsum("ip,jq->pqij", one, two).reshape(len(inside), -1)  # (h w, amplitudes)
    mean = basis[inside].mean(0)
    amplitudes = evidence.calibration.amplitudes.ravel()

    shape = len(first), len(second)
    to_down, to_across = units(evidence)
    whole = 1e6 * float(mean @ amplitudes)
    height = 1e6 * ((basis - mean) @ amplitudes).reshape(shape)
    covariance = evidence.calibration.covariance[: len(amplitudes), : len(amplitudes)]
    if not covariance.size:
        return Heights(
            second * to_across, first * to_down, inside.reshape(shape), height, None, whole, 0.0
        )
    root = 1e6 * root_of(covariance)
    sigma = np.linalg.norm((basis - mean) @ root, axis=-1).reshape(shape)
    mean_sigma = float(np.linalg.norm(mean @ root))
    return Heights(
        second * to_across, first * to_down, inside.reshape(shape), height, sigma, whole, mean_sigma
    )


def _range(values: Array, glass: Heights) -> tuple[float, float]:
    seen = values[glass.seen]
    return float(seen.min()), float(seen.max())

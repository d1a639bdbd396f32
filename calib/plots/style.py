"""Colours, colour maps and panels of matplotlib's figures: those of the report on light."""

from collections.abc import Callable, Sequence
from itertools import chain
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from numpy.typing import NDArray

INK, FAINT = "#1b2129", "#66707c"
SERIES = ("#1f78c8", "#d8621b", "#23875a", "#8350c8", "#b8336a")
BLUE, ORANGE = "#2f8fdd", "#e8833a"
ONE_SIDED = LinearSegmentedColormap.from_list(
    "more", [(*to_rgb(BLUE), 0.04), (*to_rgb(BLUE), 0.95)]
)
TWO_SIDED = LinearSegmentedColormap.from_list(
    "below and above",
    [
        (0, (*to_rgb(ORANGE), 1.0)),
        (0.499, (*to_rgb(ORANGE), 0.0)),
        (0.501, (*to_rgb(BLUE), 0.0)),
        (1, (*to_rgb(BLUE), 1.0)),
    ],
)
ERRORS = LinearSegmentedColormap.from_list("errors", ["#2f8fdd", "#f0b838", "#d63030"])
"""The colours of boards, from a small error to a large one."""
VIEW_ERRORS = LinearSegmentedColormap.from_list("views", ["#a9cdf0", "#0b3f75"])
"""The colours of views, from a small error to a large one."""
TOP, BOTTOM = 0.34, 0.48
"""Inches: the margins above and below the panels of a figure."""
WIDTH = 10.0
"""Inches."""
MAX_PANEL_HEIGHT = 4.2
"""Inches."""
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.edgecolor": FAINT,
    "axes.linewidth": 0.8,
    "axes.axisbelow": True,
    "text.color": INK,
    "axes.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "image.interpolation": "none",
    "axes.formatter.useoffset": False,
}


def draw_figure(
    panel: tuple[float, float], paint: Callable[[Figure], None], width: float = WIDTH
) -> Figure:
    """Return a figure that a function paints. The user's matplotlibrc does not change it.

    Args:
        panel: width and height in inches of an image panel; the height is that of all panels.
        width: inches
    """
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        figure = Figure((width, panel[1] + TOP + BOTTOM))
        paint(figure)
    return figure


def side_by_side(figure: Figure, widths: Sequence[float], gaps: Sequence[float]) -> list[Axes]:
    """Add a row of panels with these widths, and a gap to the left of each, in inches."""
    figure_width, figure_height = figure.get_size_inches()
    x, panels = 0.0, []
    for width, gap in zip(widths, gaps, strict=True):
        x += gap
        panels.append(
            figure.add_axes(
                (
                    x / figure_width,
                    BOTTOM / figure_height,
                    width / figure_width,
                    1 - (TOP + BOTTOM) / figure_height,
                )
            )
        )
        x += width
    return panels


def panel_size(ratio: float, width: float) -> tuple[float, float]:
    """Return the width and height in inches of a panel with a ratio of sides, no wider than given
    and no taller than MAX_PANEL_HEIGHT.
    """
    return min(width, MAX_PANEL_HEIGHT * ratio), min(width / ratio, MAX_PANEL_HEIGHT)


def image_axes(axes: Axes, width: int, height: int) -> None:
    """Set the axes of the camera's picture: x to the right, y down, in px."""
    axes.set(
        xlim=(-0.5, width - 0.5),
        ylim=(height - 0.5, -0.5),
        xlabel="x (px)",
        ylabel="y (px)",
        aspect="equal",
    )
    axes.locator_params(nbins=5)


def label_lines(
    axes: Axes,
    lines: ContourSet,
    fmt: str = "%g",
    size: float = 8.5,
    marks: NDArray[np.float64] | None = None,
) -> None:
    """Label each contour with its level, as far as possible from the panel's border, other labels
    and (n, 2) marks. A contour without room gets no label.
    """
    box, placed = axes.bbox, np.empty((0, 2)) if marks is None else axes.transData.transform(marks)
    mark_count = len(placed)
    for line in filter(len, chain.from_iterable(lines.allsegs)):
        points = axes.transData.transform(line)  # px of the figure
        room = np.minimum(points - box.min, box.max - points).min(1)
        if len(placed):
            room = np.minimum(room, np.linalg.norm(points[:, None] - placed, axis=-1).min(1))
        if room.max() > 1.5 * size / 72 * axes.figure.dpi:
            placed = np.vstack([placed, points[room.argmax()]])
    axes.clabel(
        lines,
        fmt=fmt,
        fontsize=size,
        manual=axes.transData.inverted().transform(placed[mark_count:]),
    )


def colour_bar(shown: ScalarMappable, axes: Axes, unit: str, extend: str = "neither") -> None:
    """Add a colour bar to the right of a panel; it takes 0.6 inches."""
    figure = axes.figure
    assert isinstance(figure, Figure)
    wide = figure.get_size_inches()[0]
    box = axes.get_position()
    place = (box.x1 + 0.1 / wide, box.y0, 0.11 / wide, box.height)
    bar = figure.colorbar(shown, cax=figure.add_axes(place), extend=extend)
    bar.outline.set_visible(False)
    bar.ax.set_title(unit, fontsize=8.5)

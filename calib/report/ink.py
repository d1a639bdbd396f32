"""Figures that read well on light and on dark: matplotlib's SVG with the page's own colours and
type.

matplotlib knows no CSS, so it draws with stand-in colours, which become the variables of style.css.
What would be large as lines and dots is drawn into a picture (`rasterized=True`), in colours of
middle lightness, the page showing through.
"""

import re
from collections.abc import Callable, Sequence
from io import StringIO
from itertools import chain
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, hsv_to_rgb, to_rgb
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from numpy.typing import NDArray

from calib.report.axis_marks import axis_marks, ticks
from calib.report.stand_in import FAINT, INK, SERIES, VARIABLES

__all__ = ["FAINT", "INK", "SERIES", "VARIABLES"]

BLUE, ORANGE = "#2f8fdd", "#e8833a"
"""Of pictures, which keep their colour."""
MORE = LinearSegmentedColormap.from_list("more", [(*to_rgb(BLUE), 0.04), (*to_rgb(BLUE), 0.95)])
BELOW_AND_ABOVE = LinearSegmentedColormap.from_list(
    "below and above",
    [
        (0, (*to_rgb(ORANGE), 1.0)),
        (0.499, (*to_rgb(ORANGE), 0.0)),
        (0.501, (*to_rgb(BLUE), 0.0)),
        (1, (*to_rgb(BLUE), 1.0)),
    ],
)
RASTER_DPI = 140
WIDTH, TOP, BOTTOM = 10.0, 0.34, 0.48
"""Inches: of a figure, above its panels, and below them."""
TALLEST = 4.2
"""Inches, of a panel."""
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titlepad": 7,
    "axes.titley": (
        1.0
    ),  # else every title looks for its place among the ticks, a third of a figure's time
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
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


def draw(name: str, panel: tuple[float, float], paint: Callable[[Figure], None]) -> str:
    """An inline SVG; its ids begin with `name`, so that a page may hold many.

    Args:
        panel: width and height in inches of an image panel; the height is that of all panels.
    """
    with mpl.rc_context():
        mpl.rcdefaults()  # not the person's own matplotlibrc
        mpl.rcParams.update({**STYLE, "svg.hashsalt": name})
        figure = Figure((WIDTH, panel[1] + TOP + BOTTOM))
        paint(figure)
        marks = axis_marks(figure)
        buffer = StringIO()
        figure.savefig(
            buffer,
            format="svg",
            dpi=RASTER_DPI,
            metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")),
        )
    return _inline(buffer.getvalue().replace("</svg>", f"{marks}</svg>"), name)


def _inline(svg: str, name: str) -> str:
    svg = svg[svg.index("<svg") :]
    svg = re.sub(
        r'<svg[^>]*?viewBox="([^"]+)"[^>]*>',
        rf'<svg viewBox="\1" role="img" aria-labelledby="{name}-title">',
        svg,
        count=1,
    )
    svg = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", svg, count=1, flags=re.DOTALL)
    used = set(re.findall(r'(?:url\(|href=")#([^)"]+)', svg))

    def tag(found: re.Match[str]) -> str:
        said = re.sub(r"font-family: [^;\"]*;? ?", "", found[0])
        said = re.sub(r"(\.\d\d)\d+", r"\1", said)
        said = re.sub(
            r' id="([^"]+)"', lambda own: f' id="{name}-{own[1]}"' if own[1] in used else "", said
        )
        said = re.sub(r'(url\(|href=")#', rf"\1#{name}-", said).replace("xlink:href", "href")
        for colour, variable in VARIABLES.items():
            said = said.replace(colour, f"var({variable})")
        return said

    return re.sub(r"<[^>]+>", tag, svg)


def side_by_side(figure: Figure, widths: Sequence[float], gaps: Sequence[float]) -> list[Axes]:
    """Panels beside each other, with a gap to the left of each; inches."""
    wide, high = figure.get_size_inches()
    left, panels = 0.0, []
    for width, gap in zip(widths, gaps, strict=True):
        left += gap
        panels.append(
            figure.add_axes((left / wide, BOTTOM / high, width / wide, 1 - (TOP + BOTTOM) / high))
        )
        left += width
    return panels


def fitted(ratio: float, width: float) -> tuple[float, float]:
    """Width and height in inches of a panel with a ratio of sides, no wider than given and no
    taller than TALLEST.
    """
    return min(width, TALLEST * ratio), min(width / ratio, TALLEST)


def hues(count: int) -> NDArray[np.float64]:
    """(count, 3) colours around the wheel, of middle lightness: for pictures on either ground."""
    wheel = np.linspace(0, 1, count, endpoint=False)
    return np.asarray(hsv_to_rgb(np.stack([wheel, np.full(count, 0.72), np.full(count, 0.86)], -1)))


def image_axes(axes: Axes, width: int, height: int) -> None:
    """The camera's picture: x to the right, y down, px."""
    axes.set(
        xlim=(-0.5, width - 0.5),
        ylim=(height - 0.5, -0.5),
        xlabel="x (px)",
        ylabel="y (px)",
        aspect="equal",
    )
    axes.locator_params(nbins=5)


def grid_lines(axes: Axes) -> None:
    """At the ticks of a panel whose limits are set, below what it shows."""
    style: dict[str, Any] = {"colors": [FAINT], "alpha": 0.35, "linewidths": 0.6, "zorder": 0.5}
    axes.vlines(ticks(axes.xaxis), *axes.get_ylim(), **style)
    axes.hlines(ticks(axes.yaxis), *axes.get_xlim(), **style)


def label_lines(
    axes: Axes,
    lines: ContourSet,
    fmt: str = "%g",
    size: float = 8.5,
    marks: NDArray[np.float64] | None = None,
) -> None:
    """Write each contour's level where the panel's border, the other labels and (n, 2) marks are
    farthest; one without room gets none.
    """
    box, placed = axes.bbox, np.empty((0, 2)) if marks is None else axes.transData.transform(marks)
    given = len(placed)
    for line in filter(len, chain.from_iterable(lines.allsegs)):
        at = axes.transData.transform(line)  # px of the figure
        room = np.minimum(at - box.min, box.max - at).min(1)
        if len(placed):
            room = np.minimum(room, np.linalg.norm(at[:, None] - placed, axis=-1).min(1))
        if room.max() > 1.5 * size / 72 * axes.figure.dpi:
            placed = np.vstack([placed, at[room.argmax()]])
    axes.clabel(
        lines, fmt=fmt, fontsize=size, manual=axes.transData.inverted().transform(placed[given:])
    )


def colour_bar(
    figure: Figure, shown: ScalarMappable, axes: Axes, unit: str, extend: str = "neither"
) -> None:
    """The key to a field's colours, to the right of a panel: it takes 0.6 inches."""
    wide = figure.get_size_inches()[0]
    box = axes.get_position()
    with mpl.rc_context({"axes.titley": None}):  # above the bar's pointed end, where it has one
        bar = figure.colorbar(
            shown,
            cax=figure.add_axes((box.x1 + 0.1 / wide, box.y0, 0.11 / wide, box.height)),
            extend=extend,
        )
        bar.outline.set_visible(False)
        bar.ax.set_title(unit, fontsize=8.5)

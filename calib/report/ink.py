"""Drawing of figures as SVG in the colours and fonts of the page, for light and dark themes.

matplotlib knows no CSS, so it draws with placeholder colours, which are then replaced by the
variables of style.css. Many lines or dots would make a large SVG: they are drawn into a transparent
picture (`rasterized=True`), in colours of medium lightness.
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
"""Colours of rasterized parts, which are the same in both themes."""
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
RASTER_DPI = 140
WIDTH, TOP, BOTTOM = 10.0, 0.34, 0.48
"""Inches: the width of a figure, and the margins above and below its panels."""
MAX_PANEL_HEIGHT = 4.2
"""Inches."""
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titlepad": 7,
    "axes.titley": (1.0),  # a fixed place: matplotlib's search for one takes a third of the time
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


def draw_svg(name: str, panel: tuple[float, float], paint: Callable[[Figure], None]) -> str:
    """Return an inline SVG. Its ids begin with `name`, so that a page may hold many.

    Args:
        panel: width and height in inches of an image panel; the height is that of all panels.
    """
    with mpl.rc_context():
        mpl.rcdefaults()  # the user's matplotlibrc must not matter
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

    def tag(match: re.Match[str]) -> str:
        text = re.sub(r"font-family: [^;\"]*;? ?", "", match[0])
        text = re.sub(r"(\.\d\d)\d+", r"\1", text)
        text = re.sub(
            r' id="([^"]+)"',
            lambda id_match: f' id="{name}-{id_match[1]}"' if id_match[1] in used else "",
            text,
        )
        text = re.sub(r'(url\(|href=")#', rf"\1#{name}-", text).replace("xlink:href", "href")
        for colour, variable in VARIABLES.items():
            text = text.replace(colour, f"var({variable})")
        return text

    return re.sub(r"<[^>]+>", tag, svg)


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
    """Width and height in inches of a panel with a ratio of sides, no wider than given and no
    taller than TALLEST.
    """
    return min(width, MAX_PANEL_HEIGHT * ratio), min(width / ratio, MAX_PANEL_HEIGHT)


def hues(count: int) -> NDArray[np.float64]:
    """Return (count, 3) colours around the wheel, of medium lightness for both themes."""
    wheel = np.linspace(0, 1, count, endpoint=False)
    return np.asarray(hsv_to_rgb(np.stack([wheel, np.full(count, 0.72), np.full(count, 0.86)], -1)))


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


def grid_lines(axes: Axes) -> None:
    """Draw grid lines at the ticks of a panel whose limits are set, behind its content."""
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


def colour_bar(
    figure: Figure, shown: ScalarMappable, axes: Axes, unit: str, extend: str = "neither"
) -> None:
    """Add a colour bar to the right of a panel; it takes 0.6 inches."""
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

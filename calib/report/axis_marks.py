"""Ticks, tick labels and axis labels, written as SVG at the places where matplotlib puts them.

matplotlib creates five artists for every tick, which took more time than the rest of the figure.
"""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from numpy.typing import NDArray

from calib.report.stand_in import FAINT, INK

Array = NDArray[np.float64]

POINTS = 72.0
SIZE = 9.0
"""pt, the font size."""
TICK, PAD = 3.5, 7.0
"""pt: the length of a tick, and the distance from the frame to a y tick label."""
NUMBERS_BELOW, NAME_BELOW = 13.84, 26.84
"""pt from the frame down to the baseline of the x tick labels, and of the axis label."""
NUMBER_DROP, NAME_GAP = 3.42, 6.17
"""pt from a y tick down to the baseline of its label, and from the longest label to the baseline of
the axis label.
"""
WIDTHS = {".": 0.318, "−": 0.838, "-": 0.361}
DIGIT = 0.636
"""Widths of the letters of DejaVu Sans, as fractions of the font size."""


def axis_marks(figure: Figure) -> str:
    """Return the marks of every panel as SVG, and hide matplotlib's own."""
    return "".join(
        mark for axes in figure.axes if axes.axison for mark in _panel_marks(figure, axes)
    )


def ticks(axis: Axis) -> Array:
    """Return the (n,) visible major ticks of an axis, in the unit of the axis."""
    places = np.asarray(axis.get_majorticklocs(), np.float64)
    low, high = sorted(axis.get_view_interval())
    tolerance = 1e-9 * (high - low)
    return places[(places >= low - tolerance) & (places <= high + tolerance)]


def _panel_marks(figure: Figure, axes: Axes) -> Iterator[str]:
    axes.apply_aspect()
    high, to_points = figure.get_size_inches()[1] * POINTS, POINTS / figure.dpi
    x_min, low, x_max, up = (np.asarray(axes.bbox.extents) * to_points).tolist()
    bottom, top = high - low, high - up
    x, y = axes.xaxis, axes.yaxis
    if len(x_ticks := ticks(x)):
        positions = (
            axes.transData.transform(np.column_stack([x_ticks, np.zeros(len(x_ticks))]))[:, 0]
            * to_points
        )
        yield _path(f"M{place:.2f} {bottom:.2f}v{TICK}" for place in positions)
        for place, number in zip(
            positions, x.get_major_formatter().format_ticks(x_ticks.tolist()), strict=True
        ):
            yield _text(place, bottom + NUMBERS_BELOW, number, "middle")
    yield _text((x_min + x_max) / 2, bottom + NAME_BELOW, x.get_label_text(), "middle")
    if len(y_ticks := ticks(y)):
        positions = (
            high
            - axes.transData.transform(np.column_stack([np.zeros(len(y_ticks)), y_ticks]))[:, 1]
            * to_points
        )
        on_the_right = y.get_ticks_position() == "right"
        edge, direction, anchor = (x_max, 1, "start") if on_the_right else (x_min, -1, "end")
        yield _path(f"M{edge:.2f} {place:.2f}h{direction * TICK}" for place in positions)
        numbers = y.get_major_formatter().format_ticks(y_ticks.tolist())
        for place, number in zip(positions, numbers, strict=True):
            yield _text(edge + direction * PAD, place + NUMBER_DROP, number, anchor)
        longest = (
            max(sum(WIDTHS.get(letter, DIGIT) for letter in number) for number in numbers) * SIZE
        )
        if name := y.get_label_text():
            place = f"{x_min - PAD - longest - NAME_GAP:.2f} {(top + bottom) / 2:.2f}"
            yield (
                f'<text style="{_style("middle")}" transform="translate({place})'
                f' rotate(-90)">{escape(name)}</text>'
            )
    for axis in (x, y):
        axis.set_visible(False)


def _path(lines: Iterator[str]) -> str:
    return f'<path d="{"".join(lines)}" style="stroke: {FAINT}; stroke-width: 0.8"/>'


def _text(x: float, y: float, label: str, anchor: str) -> str:
    return (
        f'<text style="{_style(anchor)}" x="{x:.2f}" y="{y:.2f}">{escape(label)}</text>'
        if label
        else ""
    )


def _style(anchor: str) -> str:
    return f"font-size: {SIZE:g}px; text-anchor: {anchor}; fill: {INK}"

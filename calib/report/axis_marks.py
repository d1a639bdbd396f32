"""Ticks, their numbers and the names of axes, written as SVG: matplotlib makes an object of five
artists of every tick, which took more time than all that its figures show. Where they stand is
where matplotlib would have put them.
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
"""pt, of the letters."""
TICK, PAD = 3.5, 7.0
"""pt: a tick's length, and from the frame to a number beside it."""
BELOW, NAME_BELOW = 13.84, 26.84
"""pt from the frame down to the feet of numbers, and of the axis's name."""
RAISED, BESIDE = 3.42, 6.17
"""pt from a tick down to the feet of its number, and from the longest number to those of the axis's
name.
"""
WIDTHS = {".": 0.318, "−": 0.838, "-": 0.361}
DIGIT = 0.636
"""Of the size, what letters of DejaVu Sans are wide."""


def axis_marks(figure: Figure) -> str:
    """Those of every panel, which matplotlib then leaves out."""
    return "".join(mark for axes in figure.axes if axes.axison for mark in _of_panel(figure, axes))


def ticks(axis: Axis) -> Array:
    """The places of an axis's ticks that are in sight, in its own unit."""
    places = np.asarray(axis.get_majorticklocs(), np.float64)
    low, high = sorted(axis.get_view_interval())
    beyond = 1e-9 * (high - low)
    return places[(places >= low - beyond) & (places <= high + beyond)]


def _of_panel(figure: Figure, axes: Axes) -> Iterator[str]:
    axes.apply_aspect()
    high, to_points = figure.get_size_inches()[1] * POINTS, POINTS / figure.dpi
    left, low, right, up = (np.asarray(axes.bbox.extents) * to_points).tolist()
    bottom, top = high - low, high - up
    x, y = axes.xaxis, axes.yaxis
    if len(across := ticks(x)):
        at = (
            axes.transData.transform(np.column_stack([across, np.zeros(len(across))]))[:, 0]
            * to_points
        )
        yield _path(f"M{place:.2f} {bottom:.2f}v{TICK}" for place in at)
        for place, number in zip(
            at, x.get_major_formatter().format_ticks(across.tolist()), strict=True
        ):
            yield _text(place, bottom + BELOW, number, "middle")
    yield _text((left + right) / 2, bottom + NAME_BELOW, x.get_label_text(), "middle")
    if len(down := ticks(y)):
        at = (
            high
            - axes.transData.transform(np.column_stack([np.zeros(len(down)), down]))[:, 1]
            * to_points
        )
        beside = y.get_ticks_position() == "right"
        edge, way, anchor = (right, 1, "start") if beside else (left, -1, "end")
        yield _path(f"M{edge:.2f} {place:.2f}h{way * TICK}" for place in at)
        numbers = y.get_major_formatter().format_ticks(down.tolist())
        for place, number in zip(at, numbers, strict=True):
            yield _text(edge + way * PAD, place + RAISED, number, anchor)
        longest = (
            max(sum(WIDTHS.get(letter, DIGIT) for letter in number) for number in numbers) * SIZE
        )
        if name := y.get_label_text():
            place = f"{left - PAD - longest - BESIDE:.2f} {(top + bottom) / 2:.2f}"
            yield (
                f'<text style="{_style("middle")}" transform="translate({place})'
                f' rotate(-90)">{escape(name)}</text>'
            )
    for axis in (x, y):
        axis.set_visible(False)


def _path(lines: Iterator[str]) -> str:
    return f'<path d="{"".join(lines)}" style="stroke: {FAINT}; stroke-width: 0.8"/>'


def _text(x: float, y: float, said: str, anchor: str) -> str:
    return (
        f'<text style="{_style(anchor)}" x="{x:.2f}" y="{y:.2f}">{escape(said)}</text>'
        if said
        else ""
    )


def _style(anchor: str) -> str:
    return f"font-size: {SIZE:g}px; text-anchor: {anchor}; fill: {INK}"

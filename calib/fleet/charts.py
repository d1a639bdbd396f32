"""The drawings of a fleet as SVG: every camera as a cell, control charts, and shifts from priors.

Marks of one colour are one path, so that ten thousand cameras stay small.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape

import numpy as np

from calib.fleet.control import Chart
from calib.fleet.findings import Fleet, title_of
from calib.fleet.result import CAMERAS, JobState
from calib.report.payload import Data
from calib.verdict.verdict import Trust

WIDTH, HEIGHT = 520, 168
LEFT, RIGHT, TOP, BOTTOM = 62, 12, 12, 20
"""Margins of a chart, px."""
COLOURS = 5
"""Number of batches that get colours: --series-0 and on, of the report's style."""
MAX_NAMES = 8
"""Outliers that have their names in one chart; more would cover each other."""
LETTER_WIDTH = 7.4
"""px, of a name's letter."""
LINE_HEIGHT = 12.0
"""px, between names."""
CELLS = 50
"""Cells in a row of the map, for a fleet of up to CELLS * ROWS cameras."""
ROWS = 20
MAP_WIDTH = 1100
"""px, of the map and of the shifts from priors."""


def link_of(fleet: Fleet, index: int) -> str:
    """Return the path of a camera's report, or of its JSON if there is no report, relative to the
    fleet's folder.
    """
    return fleet.results[index].report or f"{CAMERAS}/{fleet.results[index].id}.json"


def summary_of(fleet: Fleet, index: int) -> str:
    """Return a camera's name and its gravest finding."""
    camera = fleet.entries[index].id
    findings = fleet.findings.get(camera, ())
    return f"{camera}: {findings[0].sentence}" if findings else camera


def colours_of(fleet: Fleet) -> tuple[str, dict[str, int]]:
    """Return the factor that colours cameras, fixture or date, and the colour of each label.

    Both are empty if either factor has one label, or too many.
    """
    for factor, labels in (
        ("fixture", [entry.fixture for entry in fleet.entries]),
        ("date", list(map(fleet.day, range(len(fleet.entries))))),
    ):
        distinct = sorted({label for label in labels if label})
        if 1 < len(distinct) <= COLOURS:
            return factor, {label: index for index, label in enumerate(distinct)}
    return "", {}


def labels_of(fleet: Fleet, factor: str) -> list[str]:
    """Return each camera's label of a factor."""
    return [
        fleet.day(index) if factor == "date" else entry.fixture if factor else ""
        for index, entry in enumerate(fleet.entries)
    ]


def map_svg(fleet: Fleet) -> str:
    """Draw a cell for each camera, in the order of the charts. Those that stand out are links."""
    count = len(fleet.entries)
    columns = CELLS if count <= CELLS * ROWS else int(np.ceil(np.sqrt(count * CELLS / ROWS)))
    side = MAP_WIDTH / columns
    kinds: dict[str, list[str]] = {"usual": [], "doubted": []}
    links = []
    for index, result in enumerate(fleet.results):
        x, y = side * (index % columns), side * (index // columns)
        square = f"M{x + 1:.1f} {y + 1:.1f}h{side - 2:.1f}v{side - 2:.1f}h{2 - side:.1f}z"
        if result.id in fleet.findings:
            kind = "out" if result.state is JobState.CALIBRATED else "none"
            links.append(
                _linked(
                    fleet,
                    index,
                    f'<path class="{kind}" d="{square}">{_title(summary_of(fleet, index))}</path>',
                )
            )
        else:
            kinds[
                "usual" if result.verdict.get("word") == Trust.TRUSTED.value else "doubted"
            ].append(square)
    cells = "".join(
        f'<path class="{kind}" d="{"".join(squares)}"/>'
        for kind, squares in kinds.items()
        if squares
    )
    rows = -(-count // columns)
    return (
        f'<svg viewBox="0 0 {MAP_WIDTH} {side * rows:.1f}" role="img" aria-label="the'
        f' cameras">{cells}{"".join(links)}</svg>'
    )


def chart_svg(chart: Chart, fleet: Fleet, colour: Mapping[str, int], labels: Sequence[str]) -> str:
    """Draw every camera's number from left to right, the centre, the limits, and the names of
    outliers.
    """
    value = chart.value
    outlying = chart.is_outlier
    measured = np.flatnonzero(np.isfinite(value))
    centres = chart_centres(chart)
    limits = [chart.limits(centre) for centre in centres]
    scale = np.log if chart.one_sided else np.asarray
    minimum, maximum, margin = _span(chart)
    count = len(value)

    def x_of(index: int) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (index + 0.5) / count

    def height_of(number: float) -> float:
        """Return 0 at the bottom of the chart's field and 1 at its top."""
        return (float(scale(number)) - minimum + margin) / (maximum - minimum + 2 * margin)

    def y_of(number: float) -> float:
        return TOP + (HEIGHT - TOP - BOTTOM) * (1 - min(1.0, max(0.0, height_of(number))))

    lines = "".join(_lines(chart, centres, limits, colour, y_of))
    dots: dict[int, list[str]] = {}
    for index in measured[~outlying[measured]].tolist():
        dots.setdefault(colour.get(labels[index], 0), []).append(
            f"M{x_of(index):.1f} {y_of(value[index]):.1f}h0"
        )
    size = 5.0 if count <= 300 else 3.0 if count <= 2000 else 1.8
    drawn = "".join(
        f'<path class="dots" style="stroke: var(--series-{series}); stroke-width: {size}"'
        f' d="{"".join(paths)}"/>'
        for series, paths in dots.items()
    )
    outliers = [
        (index, x_of(index), y_of(value[index])) for index in np.flatnonzero(outlying).tolist()
    ]
    marks = "".join(
        _linked(fleet, i, _mark(x, y, height_of(value[i]), _title(summary_of(fleet, i))))
        for i, x, y in outliers
    )
    farthest = sorted(outliers, key=lambda mark: -abs(chart.spreads[mark[0]]))[:MAX_NAMES]
    names = "".join(_names([(fleet.entries[i].id, x, y) for i, x, y in farthest]))
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title_of(chart.name))}'
        f' of each camera">{lines}{drawn}{marks}{names}</svg>'
    )


def chart_domain(chart: Chart) -> tuple[float, float]:
    """Return the lowest and the highest number that a chart shows."""
    minimum, maximum, margin = _span(chart)
    scale = np.exp if chart.one_sided else np.asarray
    return float(scale(minimum - margin)), float(scale(maximum + margin))


def _span(chart: Chart) -> tuple[float, float, float]:
    """Return the lowest and the highest number between the limits and of usual cameras, and the
    margin around them; of logarithms, if the chart is one-sided.
    """
    centres = chart_centres(chart)
    limits = [chart.limits(centre) for centre in centres]
    scale = np.log if chart.one_sided else np.asarray
    usual = chart.value[np.isfinite(chart.value) & ~chart.is_outlier]
    minima = (
        [float(usual.min()) if len(usual) else min(centres)]
        if chart.one_sided
        else [low for low, _ in limits]
    )
    minimum = float(scale(min(minima)))
    maximum = float(scale(max(high for _, high in limits)))
    return minimum, maximum, 0.25 * (maximum - minimum)


def chart_centres(chart: Chart) -> list[float]:
    """Return the centre of each batch, or of the fleet."""
    measured = np.flatnonzero(np.isfinite(chart.value))
    return [batch.centre for batch in chart.batches] or [float(chart.centre[measured[0]])]


def chart_data(chart: Chart, colour: Mapping[str, int], labels: Sequence[str]) -> Data:
    """Return what the page's scripts draw a chart from."""
    batches = [batch.name for batch in chart.batches] or [""]
    lines = []
    for batch, centre in zip(batches, chart_centres(chart), strict=True):
        low, high = chart.limits(centre)
        series = colour.get(batch)
        lines.append({"at": centre, "limit": False, "series": series})
        lines.append({"at": high, "limit": True, "series": series})
        if not chart.one_sided:
            lines.append({"at": low, "limit": True, "series": series})
    return {
        "value": chart.value,
        "outlier": chart.is_outlier.astype(np.int64),
        "series": np.array([colour.get(label, 0) for label in labels]),
        "spread": chart.spreads,
        "lines": lines,
        "domain": chart_domain(chart),
        "logarithmic": chart.one_sided,
        "unit": chart.unit,
    }


def _lines(
    chart: Chart,
    centres: Sequence[float],
    limits: Sequence[tuple[float, float]],
    colour: Mapping[str, int],
    y_of: Callable[[float], float],
) -> Iterator[str]:
    """Yield lines for centres and limits, with those numbers that do not cover each other."""
    names = [batch.name for batch in chart.batches] or [""]
    written: list[float] = []
    for name, centre, (low, high) in zip(names, centres, limits, strict=True):
        style = f' style="stroke: var(--series-{colour[name]})"' if name in colour else ""
        for kind, number in (
            ("centre", centre),
            ("limit", high),
            *(() if chart.one_sided else (("limit", low),)),
        ):
            y = y_of(number)
            yield f'<path class="{kind}"{style} d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}"/>'
            if all(abs(y - previous) > LINE_HEIGHT for previous in written):
                written.append(y)
                yield (
                    f'<text x="{LEFT - 6}" y="{y + 4:.1f}"'
                    f' text-anchor="end">{_short(number, high - low)}</text>'
                )


def _short(number: float, span: float) -> str:
    """Return a number with the digits that a hundredth of a span needs."""
    places = max(0, int(np.ceil(2 - np.log10(span)))) if span > 0 else 3
    return f"{number:.{min(places, 5)}f}"


def _mark(x: float, y: float, height: float, title: str) -> str:
    """Draw a dot, or an arrow at the edge of the field if the dot would be beyond it."""
    if 0 <= height <= 1:
        return f'<circle class="out" cx="{x:.1f}" cy="{y:.1f}" r="4.5">{title}</circle>'
    sign = -1 if height > 1 else 1
    return f'<path class="out" d="M{x:.1f} {y + 6 * sign:.1f}l6 {-10 * sign}h-12z">{title}</path>'


def _names(marks: Sequence[tuple[str, float, float]]) -> Iterator[str]:
    """Draw names next to their marks, so that none covers another."""
    taken = [(x - 7, x + 7, y + 4) for _, x, y in marks]
    for name, x, y in sorted(marks, key=lambda mark: mark[1]):
        width = LETTER_WIDTH * len(name)
        right = x + 8 + width < WIDTH
        x_min = x + 8 if right else x - 8 - width
        offsets = sorted((step * LINE_HEIGHT for step in range(-10, 11)), key=abs)
        near = [line for start, end, line in taken if start < x_min + width and x_min < end]
        candidates = (y + 4 + offset for offset in offsets if TOP < y + 4 + offset < HEIGHT - 4)
        free = next(
            (
                candidate
                for candidate in candidates
                if all(abs(candidate - line) >= LINE_HEIGHT for line in near)
            ),
            y + 4,
        )
        taken.append((x_min, x_min + width, free))
        anchored = f'x="{x_min:.1f}"' if right else f'x="{x - 8:.1f}" text-anchor="end"'
        yield f'<text class="name" {anchored} y="{free:.1f}">{escape(name)}</text>'


def shifts_svg(fleet: Fleet) -> str:
    """Draw a row for each number: the shifts of all cameras from their priors, in sigmas.

    Return an empty text without priors.
    """
    names = list(dict.fromkeys(name for result in fleet.results for name in result.shifts))
    if not names:
        return ""
    line = 24
    label_width = 190
    reach = 1.6 * fleet.shift_limit
    height = line * len(names) + 34

    def x_of(sigmas: float) -> float:
        return (
            label_width
            + (MAP_WIDTH - label_width - 20) * (min(1.0, max(-1.0, sigmas / reach)) + 1) / 2
        )

    drawings = []
    for kind, at, text in (
        ("limit", -fleet.shift_limit, f"-{fleet.shift_limit:.1f}"),
        ("centre", 0.0, "0 sigma"),
        ("limit", fleet.shift_limit, f"+{fleet.shift_limit:.1f}"),
    ):
        x = x_of(at)
        drawings.append(f'<path class="{kind}" d="M{x:.1f} 4V{height - 26}"/>')
        drawings.append(f'<text x="{x:.1f}" y="{height - 8}" text-anchor="middle">{text}</text>')
    for row, name in enumerate(names):
        y = 14 + line * row
        drawings.append(
            f'<text x="{label_width - 10}" y="{y + 4}" text-anchor="end">'
            f"{escape(title_of(name))}</text>"
        )
        dots, links = [], []
        for index, result in enumerate(fleet.results):
            if (shift := result.shifts.get(name)) and np.isfinite(shift.sigmas):
                x = x_of(shift.sigmas)
                if abs(shift.sigmas) > fleet.shift_limit:
                    title = _title(
                        f"{result.id}: {shift.prior:.6g} to {shift.current:.6g} {shift.unit},"
                        f" {shift.sigmas:+.1f} sigmas"
                    )
                    links.append(
                        _linked(
                            fleet,
                            index,
                            f'<circle class="out" cx="{x:.1f}" cy="{y}" r="4.5">{title}</circle>',
                        )
                    )
                else:
                    dots.append(f"M{x:.1f} {y}h0")
        drawings.append(
            '<path class="dots" style="stroke: var(--series-0); stroke-width: 4"'
            f' d="{"".join(dots)}"/>{"".join(links)}'
        )
    return (
        f'<svg viewBox="0 0 {MAP_WIDTH} {height}" role="img" aria-label="changes against'
        f' priors">{"".join(drawings)}</svg>'
    )


def _linked(fleet: Fleet, index: int, drawn: str) -> str:
    return f'<a href="{escape(link_of(fleet, index))}">{drawn}</a>'


def _title(text: str) -> str:
    return f"<title>{escape(text)}</title>"

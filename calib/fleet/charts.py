"""The drawings of a fleet as SVG: every camera as a cell, control charts, and changes against
priors. Ten thousand cameras are one path.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape

import numpy as np

from calib.fleet.control import Chart
from calib.fleet.findings import Fleet, title_of
from calib.fleet.result import CAMERAS, State
from calib.verdict.verdict import Word

WIDTH, HEIGHT = 520, 168
LEFT, RIGHT, TOP, BOTTOM = 62, 12, 12, 20
"""px around a chart's field."""
COLOURS = 5
"""Batches that are told apart by colour: --series-0 and on, of the report's style."""
NAMED = 8
"""Outliers that are named within one chart; more would cover each other."""
LETTER = 7.4
"""px of a name's letter."""
LINE = 12.0
"""px between names, one above the other."""
CELLS = 50
"""Cells in a row of the map, of a fleet of up to CELLS * ROWS cameras."""
ROWS = 20
WIDE = 1100
"""px of the map and of the changes."""


def link_of(fleet: Fleet, index: int) -> str:
    """To its report, or to its JSON where there is none; from the fleet's folder."""
    return fleet.results[index].report or f"{CAMERAS}/{fleet.results[index].id}.json"


def said_of(fleet: Fleet, index: int) -> str:
    """A camera's name and its gravest reason."""
    camera = fleet.entries[index].id
    found = fleet.findings.get(camera, ())
    return f"{camera}: {found[0].sentence}" if found else camera


def colours_of(fleet: Fleet) -> tuple[str, dict[str, int]]:
    """What tells cameras apart by colour, fixture or date, and the colour of each of its labels;
    nothing where there are too many.
    """
    for factor, labels in (
        ("fixture", [entry.fixture for entry in fleet.entries]),
        ("date", list(map(fleet.day, range(len(fleet.entries))))),
    ):
        known = sorted({label for label in labels if label})
        if 1 < len(known) <= COLOURS:
            return factor, {label: index for index, label in enumerate(known)}
    return "", {}


def labels_of(fleet: Fleet, factor: str) -> list[str]:
    """(N,) of each camera."""
    return [
        fleet.day(index) if factor == "date" else entry.fixture if factor else ""
        for index, entry in enumerate(fleet.entries)
    ]


def map_svg(fleet: Fleet) -> str:
    """A cell for each camera, in the order of the charts: those that stand out are links."""
    count = len(fleet.entries)
    columns = CELLS if count <= CELLS * ROWS else int(np.ceil(np.sqrt(count * CELLS / ROWS)))
    side = WIDE / columns
    kinds: dict[str, list[str]] = {"usual": [], "doubted": []}
    links = []
    for index, result in enumerate(fleet.results):
        x, y = side * (index % columns), side * (index // columns)
        square = f"M{x + 1:.1f} {y + 1:.1f}h{side - 2:.1f}v{side - 2:.1f}h{2 - side:.1f}z"
        if result.id in fleet.findings:
            kind = "out" if result.state is State.CALIBRATED else "none"
            links.append(
                _linked(
                    fleet,
                    index,
                    f'<path class="{kind}" d="{square}">{_title(said_of(fleet, index))}</path>',
                )
            )
        else:
            kinds[
                "usual" if result.verdict.get("word") == Word.TRUSTED.value else "doubted"
            ].append(square)
    cells = "".join(
        f'<path class="{kind}" d="{"".join(squares)}"/>'
        for kind, squares in kinds.items()
        if squares
    )
    rows = -(-count // columns)
    return (
        f'<svg viewBox="0 0 {WIDE} {side * rows:.1f}" role="img" aria-label="the'
        f' cameras">{cells}{"".join(links)}</svg>'
    )


def chart_svg(chart: Chart, fleet: Fleet, colour: Mapping[str, int], labels: Sequence[str]) -> str:
    """Every camera's number from left to right, the centre and the limits, and the names of those
    beyond.
    """
    value, out = chart.value, chart.out
    known = np.flatnonzero(np.isfinite(value))
    centres = [batch.centre for batch in chart.batches] or [float(chart.centre[known[0]])]
    limits = [chart.limits(centre) for centre in centres]
    scale = np.log if chart.one_sided else np.asarray
    usual = value[known][~out[known]]
    least = (
        [float(usual.min()) if len(usual) else min(centres)]
        if chart.one_sided
        else [low for low, _ in limits]
    )
    low, high = (float(scale(end)) for end in (min(least), max(high for _, high in limits)))
    low, high = low - 0.25 * (high - low), high + 0.25 * (high - low)
    count = len(value)

    def across(index: int) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (index + 0.5) / count

    def up(number: float) -> float:
        """Of the field: 0 at its bottom, 1 at its top."""
        return (float(scale(number)) - low) / (high - low)

    def down(number: float) -> float:
        return TOP + (HEIGHT - TOP - BOTTOM) * (1 - min(1.0, max(0.0, up(number))))

    lines = "".join(_lines(chart, centres, limits, colour, down))
    dots: dict[int, list[str]] = {}
    for index in known[~out[known]].tolist():
        dots.setdefault(colour.get(labels[index], 0), []).append(
            f"M{across(index):.1f} {down(value[index]):.1f}h0"
        )
    size = 5.0 if count <= 300 else 3.0 if count <= 2000 else 1.8
    drawn = "".join(
        f'<path class="dots" style="stroke: var(--series-{one}); stroke-width: {size}"'
        f' d="{"".join(parts)}"/>'
        for one, parts in dots.items()
    )
    beyond = [(index, across(index), down(value[index])) for index in np.flatnonzero(out).tolist()]
    marks = "".join(
        _linked(fleet, i, _mark(x, y, up(value[i]), _title(said_of(fleet, i))))
        for i, x, y in beyond
    )
    far = sorted(beyond, key=lambda one: -abs(chart.spreads[one[0]]))[:NAMED]
    names = "".join(_names([(fleet.entries[i].id, x, y) for i, x, y in far]))
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title_of(chart.name))}'
        f' of each camera">{lines}{drawn}{marks}{names}</svg>'
    )


def _lines(
    chart: Chart,
    centres: Sequence[float],
    limits: Sequence[tuple[float, float]],
    colour: Mapping[str, int],
    down: Callable[[float], float],
) -> Iterator[str]:
    names = [batch.name for batch in chart.batches] or [""]
    written: list[float] = []
    for name, centre, (low, high) in zip(names, centres, limits, strict=True):
        own = f' style="stroke: var(--series-{colour[name]})"' if name in colour else ""
        for kind, number in (
            ("centre", centre),
            ("limit", high),
            *(() if chart.one_sided else (("limit", low),)),
        ):
            y = down(number)
            yield f'<path class="{kind}"{own} d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}"/>'
            if all(abs(y - other) > LINE for other in written):
                written.append(y)
                yield (
                    f'<text x="{LEFT - 6}" y="{y + 4:.1f}"'
                    f' text-anchor="end">{_short(number, high - low)}</text>'
                )


def _short(number: float, span: float) -> str:
    """With the digits that tell a hundredth of a span."""
    places = max(0, int(np.ceil(2 - np.log10(span)))) if span > 0 else 3
    return f"{number:.{min(places, 5)}f}"


def _mark(x: float, y: float, up: float, title: str) -> str:
    """A dot, or at the field's edge an arrow to where the dot would be."""
    if 0 <= up <= 1:
        return f'<circle class="out" cx="{x:.1f}" cy="{y:.1f}" r="4.5">{title}</circle>'
    way = -1 if up > 1 else 1
    return f'<path class="out" d="M{x:.1f} {y + 6 * way:.1f}l6 {-10 * way}h-12z">{title}</path>'


def _names(marks: Sequence[tuple[str, float, float]]) -> Iterator[str]:
    """Beside their marks, none upon another."""
    taken = [(x - 7, x + 7, y + 4) for _, x, y in marks]
    for name, x, y in sorted(marks, key=lambda mark: mark[1]):
        width = LETTER * len(name)
        right = x + 8 + width < WIDTH
        left = x + 8 if right else x - 8 - width
        offsets = sorted((step * LINE for step in range(-10, 11)), key=abs)
        near = [place for begin, end, place in taken if begin < left + width and left < end]
        places = (y + 4 + off for off in offsets if TOP < y + 4 + off < HEIGHT - 4)
        free = next(
            (place for place in places if all(abs(place - other) >= LINE for other in near)), y + 4
        )
        taken.append((left, left + width, free))
        anchored = f'x="{left:.1f}"' if right else f'x="{x - 8:.1f}" text-anchor="end"'
        yield f'<text class="name" {anchored} y="{free:.1f}">{escape(name)}</text>'


def moved_svg(fleet: Fleet) -> str:
    """A row for each number: how far every camera that has a prior is from it, in sigmas.

    Empty without priors.
    """
    names = list(dict.fromkeys(name for result in fleet.results for name in result.moved))
    if not names:
        return ""
    line, left = 24, 190
    reach = 1.6 * fleet.changed_beyond
    height = line * len(names) + 34

    def across(sigmas: float) -> float:
        return left + (WIDE - left - 20) * (min(1.0, max(-1.0, sigmas / reach)) + 1) / 2

    parts = []
    for kind, at, text in (
        ("limit", -fleet.changed_beyond, f"-{fleet.changed_beyond:.1f}"),
        ("centre", 0.0, "0 sigma"),
        ("limit", fleet.changed_beyond, f"+{fleet.changed_beyond:.1f}"),
    ):
        x = across(at)
        parts.append(f'<path class="{kind}" d="M{x:.1f} 4V{height - 26}"/>')
        parts.append(f'<text x="{x:.1f}" y="{height - 8}" text-anchor="middle">{text}</text>')
    for row, name in enumerate(names):
        y = 14 + line * row
        parts.append(
            f'<text x="{left - 10}" y="{y + 4}" text-anchor="end">{escape(title_of(name))}</text>'
        )
        dots, links = [], []
        for index, result in enumerate(fleet.results):
            if (one := result.moved.get(name)) and np.isfinite(one.sigmas):
                x = across(one.sigmas)
                if abs(one.sigmas) > fleet.changed_beyond:
                    title = _title(
                        f"{result.id}: {one.before:.6g} to {one.after:.6g} {one.unit},"
                        f" {one.sigmas:+.1f} sigmas"
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
        parts.append(
            '<path class="dots" style="stroke: var(--series-0); stroke-width: 4"'
            f' d="{"".join(dots)}"/>{"".join(links)}'
        )
    return (
        f'<svg viewBox="0 0 {WIDE} {height}" role="img" aria-label="changes against'
        f' priors">{"".join(parts)}</svg>'
    )


def _linked(fleet: Fleet, index: int, drawn: str) -> str:
    return f'<a href="{escape(link_of(fleet, index))}">{drawn}</a>'


def _title(text: str) -> str:
    return f"<title>{escape(text)}</title>"

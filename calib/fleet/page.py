"""fleet.html: one file that shows a fleet, without network, on light and on dark. The
cameras that stand out come first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from html import escape
from importlib.resources import files

from calib.fleet.charts import (
    chart_data,
    chart_svg,
    colours_of,
    labels_of,
    link_of,
    map_svg,
    shifts_svg,
)
from calib.fleet.control import ALPHA, BATCH_ALPHA, Chart
from calib.fleet.findings import Fleet, title_of
from calib.fleet.result import JobState, Result
from calib.io.numerals import counted
from calib.report.page import PageSection, document
from calib.report.payload import Data
from calib.report.scripts import FLEET, Scripts
from calib.rounding import with_sigma
from calib.table import html_table
from calib.verdict.verdict import Trust

MAX_REASONS = 3
"""Reasons of a camera that are visible at once."""
MAX_OPEN = 60
"""The list of all cameras is open if they are no more than this."""
MAX_LINKS = 12
"""Cameras that the row of an effect names."""
NAMES = {
    Trust.TRUSTED.value: "trusted",
    Trust.CARE.value: "to be taken with care",
    Trust.DO_NOT_USE.value: "not to be used",
}


def fleet_page(fleet: Fleet, name: str) -> str:
    """Return the page of a fleet; `name` is its title."""
    style = "".join(
        files(package).joinpath(sheet).read_text(encoding="utf-8")
        for package, sheet in (("calib.report", "style.css"), ("calib.fleet", "fleet.css"))
    )
    sections = list(_sections(fleet))
    contents = "".join(
        f'<a href="#{section.name}">{escape(section.title)}</a>' for section in sections
    )
    body = "".join(
        f'<section id="{section.name}"><h2>{escape(section.title)}</h2>{section.html}</section>'
        for section in sections
    )
    header = f"""<p class="over">Refracal fleet: {escape(name)}</p>
<h1>{escape(headline(fleet))}</h1>
<p class="lead">{escape(_lead(fleet))}</p>
<figure class="map">{map_svg(fleet)}<figcaption class="key">{KEY}</figcaption></figure>
<nav>{contents}</nav>"""
    return document(
        f"Fleet {escape(name)}",
        style,
        header,
        body,
        colour="care" if fleet.findings else "good",
        scripts=Scripts.of(_data(fleet), FLEET) if fleet.charts else None,
    )


def _data(fleet: Fleet) -> Data:
    """Return what the page's scripts draw from."""
    factor, colour = colours_of(fleet)
    labels = labels_of(fleet, factor)
    return {
        "cameras": [
            {"name": entry.id, "link": link_of(fleet, index)}
            for index, entry in enumerate(fleet.entries)
        ],
        "figures": {
            str(place): chart_data(chart, colour, labels)
            for place, chart in enumerate(fleet.charts)
        },
    }


KEY = (
    '<i style="background: var(--usual)"></i>trusted<i style="background: var(--doubted)"></i>take'
    ' care<i style="background: var(--out)"></i>stands out<i style="background: var(--none)"></i>no'
    " calibration"
)


def headline(fleet: Fleet) -> str:
    """Return the number of cameras that stand out, as a sentence without a full stop."""
    count, total = len(fleet.findings), len(fleet.entries)
    cameras = f"camera{'s' * (total > 1)}"
    return (
        f"{count} of {total} {cameras} stand{'s' * (count == 1)} out"
        if count
        else f"None of {total} {cameras} stands out"
    )


def _lead(fleet: Fleet) -> str:
    states = Counter(result.state for result in fleet.results)
    count = states[JobState.CALIBRATED]
    words = Counter(
        str(result.verdict.get("word"))
        for result in fleet.results
        if result.state is JobState.CALIBRATED
    )
    calibrated = f"{count} camera{'s are' if count != 1 else ' is'} calibrated: " + ", ".join(
        f"{words[word]} {NAMES[word]}" for word in NAMES if words[word]
    )
    failures = len(fleet.results) - count
    failed = f"; {failures} {'have' if failures > 1 else 'has'} no calibration" if failures else ""
    return (
        f"{calibrated}{failed}. Limits come from the fleet itself, by medians: of"
        f" {1 / ALPHA:.0f} fleets without a fault, one would have a camera beyond a limit."
    )


def _sections(fleet: Fleet) -> Iterator[PageSection]:
    if fleet.findings:
        yield PageSection("out", "Who stands out, and why", _outliers_html(fleet))
    if fleet.charts:
        yield PageSection("charts", "Control charts", _charts_html(fleet))
    if any(chart.batches for chart in fleet.charts):
        yield PageSection("batches", "Batches", _batches_html(fleet.charts))
    if drawn := shifts_svg(fleet):
        yield PageSection("moved", "Against the priors", _moved_html(fleet, drawn))
    if effects := _effects_html(fleet):
        yield PageSection("effects", "Effects that were found", effects)
    yield PageSection("all", "All cameras", _all_html(fleet))


def _outliers_html(fleet: Fleet) -> str:
    place = {entry.id: index for index, entry in enumerate(fleet.entries)}
    rows = []
    for camera in fleet.outliers:
        items = [f"<li>{escape(finding.sentence)}.</li>" for finding in fleet.findings[camera]]
        first = "".join(items[:MAX_REASONS])
        hidden = "".join(items[MAX_REASONS:])
        details = (
            f"<details><summary>{len(items) - MAX_REASONS} more</summary><ul"
            f' class="reasons">{hidden}</ul></details>'
            if hidden
            else ""
        )
        rows.append((_camera(fleet, place[camera]), f'<ul class="reasons">{first}</ul>{details}'))
    return html_table(("camera", "why, the gravest first"), rows)


def _camera(fleet: Fleet, index: int) -> str:
    """Return a camera's name as a link, with its serial number, fixture and day."""
    entry = fleet.entries[index]
    labels = (entry.serial, entry.fixture, fleet.day(index))
    subtitle = ", ".join(label for label in labels if label)
    small = f"<br><small>{escape(subtitle)}</small>" if subtitle else ""
    return f'<a href="{escape(link_of(fleet, index))}"><b>{escape(entry.id)}</b></a>{small}'


def _charts_html(fleet: Fleet) -> str:
    factor, colour = colours_of(fleet)
    labels = labels_of(fleet, factor)
    key = "".join(
        f'<i style="background: var(--series-{series})"></i>{escape(label)}'
        for label, series in colour.items()
    )
    timed = any(map(fleet.day, range(len(fleet.entries))))
    order = "the order of their days" if timed else "the manifest's order"
    drawn = "".join(
        f'<div data-figure="{place}"><h3>{escape(title_of(chart.name))}'
        f" <small>{escape(_usual(chart))}</small></h3>"
        f'<div class="panels">{chart_svg(chart, fleet, colour, labels)}</div></div>'
        for place, chart in enumerate(fleet.charts)
    )
    return (
        f"<p>A dot is a camera, from left to right in {order}. The line is the median, dashed lines"
        " are the limits. A red dot is beyond them, and one beyond the chart stands at its edge. A"
        " camera whose number is less certain than usual may be farther away. Point at a dot to"
        " see which camera it is; click into a chart, and the wheel comes nearer."
        f"</p>{f'<p class=key>{escape(factor)}: {key}</p>' if key else ''}<div"
        f' class="charts">{drawn}</div>'
    )


def _usual(chart: Chart) -> str:
    """Return the median and the spread."""
    if chart.batches:
        return f"{chart.unit}, by {chart.factor}".strip(", ")
    centre = float(chart.centre[0])
    sigma = chart.spread * (centre if chart.one_sided else 1.0)
    return f"{with_sigma(centre, sigma)} {chart.unit}".rstrip()


def _batches_html(charts: tuple[Chart, ...]) -> str:
    rows = [
        (
            escape(title_of(chart.name)),
            escape(chart.factor),
            "; ".join(
                f"{escape(batch.name)}: {batch.centre:.5g} {escape(chart.unit)} ({batch.count})"
                for batch in chart.batches
            ),
            f"{chart.p_value:.1g}",
        )
        for chart in charts
        if chart.batches
    ]
    return (
        "<p>Numbers that differ between batches, by ranks (Kruskal and Wallis), at"
        f" {100 * BATCH_ALPHA:g} % over all charts. Each camera of such a chart is compared with"
        " its own batch.</p>" + html_table(("number", "by", "medians (cameras)", "p"), rows)
    )


def _moved_html(fleet: Fleet, drawn: str) -> str:
    checked = sum(bool(result.shifts) for result in fleet.results)
    return (
        f"<p>How far the numbers of {checked} cameras are from those of their priors, over the"
        " standard deviation that both give. Beyond "
        f'the dashed lines they have moved.</p><figure><div class="wide">{drawn}</div></figure>'
    )


def _effects_html(fleet: Fleet) -> str:
    """Return the table of effects; empty if no diagnosis found any."""
    cameras: dict[str, list[int]] = {}
    for index, result in enumerate(fleet.results):
        for effect in result.effects:
            cameras.setdefault(effect, []).append(index)
    if not cameras:
        return ""
    rows = []
    for effect, indices in sorted(cameras.items(), key=lambda item: -len(item[1])):
        links = ", ".join(
            f'<a href="{escape(link_of(fleet, i))}">{escape(fleet.entries[i].id)}</a>'
            for i in indices[:MAX_LINKS]
        )
        remainder = f" and {len(indices) - MAX_LINKS} more" if len(indices) > MAX_LINKS else ""
        rows.append((f"<b>{escape(effect)}</b>", str(len(indices)), links + remainder))
    return html_table(("effect", "cameras", "which"), rows)


def _all_html(fleet: Fleet) -> str:
    rows = [
        (
            _camera(fleet, index),
            escape(
                NAMES.get(str(result.verdict.get("word")), result.state.value.replace("_", " "))
            ),
            str(result.views or ""),
            *(
                _number(result, name)
                for name in ("error_px", "held_out_px", "noise_px", "sigma_px", "effective_fx")
            ),
            (
                f"{max((abs(shift.sigmas) for shift in result.shifts.values()), default=0.0):.1f}"
                if result.shifts
                else ""
            ),
        )
        for index, result in enumerate(fleet.results)
    ]
    head = (
        "camera",
        "verdict",
        "views",
        "left, px",
        "held out, px",
        "noise, px",
        "sigma, px",
        "effective focal length, px",
        "moved, sigmas",
    )
    opened = " open" if len(rows) <= MAX_OPEN else ""
    summary = f"<summary>{counted(len(rows), 'camera')}</summary>"
    return f"<details{opened}>{summary}{html_table(head, rows)}</details>"


def _number(result: Result, name: str) -> str:
    number = result.numbers.get(name)
    if not number:
        return ""
    return escape(with_sigma(number.value, number.sigma) if number.sigma else f"{number.value:.3f}")

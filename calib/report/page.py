"""The page of a report: title, verdict, contents and sections, for light and dark themes."""

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files

from calib.report.again import pasted
from calib.report.scripts import Scripts
from calib.report.summary import Summary
from calib.report.tiles import tiles_html

NOTHING_FROM_OUTSIDE = (
    "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; style-src"
    " 'unsafe-inline'"
)


COPIED = r"<(pre|code|b)\b.*?</\1>|<[^>]*>"
"""Tags, and elements whose spaces people copy: commands, and names of files."""
UNITS = "px|mm|µm|m|cm|mrad|rad|deg|ms|s|times|tolerances"
IN_NUMBER = rf"(?<=\d) (?=(?:{UNITS})\b|%|±)|(?<=±) (?=[\d-])"
"""The spaces between a number, its standard deviation and its unit."""
NO_BREAK = "\N{NO-BREAK SPACE}"


@dataclass(frozen=True, slots=True)
class PageSection:
    name: str
    """Unique in the page."""
    title: str
    html: str


def page(subject: str, summary: Summary, sections: Sequence[PageSection], scripts: Scripts) -> str:
    """Return the HTML file of a report."""
    style = files("calib.report").joinpath("style.css").read_text(encoding="utf-8")
    contents = "".join(
        f'<a href="#{section.name}">{escape(section.title)}</a>' for section in sections
    )
    lead = "".join(f"<li>{escape(sentence)}</li>" for sentence in summary.sentences)
    verdict = summary.verdict
    reasons = "".join(f"<li>{escape(reason.sentence)}</li>" for reason in verdict.reasons)
    body = "".join(
        f'<section id="{section.name}"><h2'
        f' id="{section.name}-title">{escape(section.title)}</h2>{section.html}</section>'
        for section in sections
    )
    listed = f"<ul>{reasons}</ul>" if reasons else ""
    notes = "".join(f"<p>Note: {escape(note)}</p>" for note in verdict.notes)
    header = f"""<p class="over">Refracal calibration report</p>
<h1>{escape(verdict.word.sentence.removesuffix("."))}</h1>
{tiles_html(summary.tiles)}
<ul class="lead">{lead}</ul>
{listed}{notes}
<p>Next: <code>{escape(pasted(shlex.split(verdict.next)))}</code></p>
<nav>{contents}</nav>
<noscript><p>The figures need JavaScript, which this browser does not run. The verdict, the tables
and the pictures are here without it.</p></noscript>"""
    return document(
        f"Calibration of {escape(subject)}",
        style,
        header,
        body,
        good=not verdict.reasons,
        scripts=scripts,
    )


def keep_numbers(html: str) -> str:
    """Return HTML in which no line breaks between a number and its unit."""
    return re.sub(
        f"{COPIED}|{IN_NUMBER}",
        lambda match: NO_BREAK if match[0] == " " else match[0],
        html,
        flags=re.DOTALL,
    )


def document(
    title: str, style: str, header: str, body: str, *, good: bool, scripts: Scripts | None = None
) -> str:
    """Return an HTML file that loads nothing from outside.

    Args:
        title: HTML, as are header and body.
        good: true if the header has the colour of a trusted result.
        scripts: the scripts of the page; None: it runs none.
    """
    allowed = f"; script-src {scripts.policy}" if scripts else ""
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy" content="{NOTHING_FROM_OUTSIDE}{allowed}">
<link rel="icon" href="data:,">
<title>{title}</title>
<style>
{style}</style>
</head>
<body>
<header class="{"good" if good else "care"}">
{keep_numbers(header)}
</header>
<main>{keep_numbers(body)}{scripts.html if scripts else ""}</main>
</body>
</html>
"""

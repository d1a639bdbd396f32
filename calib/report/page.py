"""The page of a report: title, verdict, contents and sections, for light and dark themes."""

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files

from calib.report.again import command_html, pasted
from calib.report.scripts import Scripts
from calib.report.summary import Summary
from calib.report.tiles import tiles_html
from calib.verdict.next_commands import HOLDOUT, HOLDOUT_NOTE, TESTED_NOTE
from calib.verdict.verdict import NEXT, Trust, Verdict
from calib.version import VERSION

NOTHING_FROM_OUTSIDE = (
    "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; style-src"
    " 'unsafe-inline'"
)


COPIED = r"<(pre|code|b)\b.*?</\1>|<[^>]*>"
"""Tags, and elements whose spaces people copy: commands, and names of files."""
UNITS = "px|mm|µm|m|cm|mrad|rad|deg|ms|s|times"
IN_NUMBER = (
    rf"(?<=\d) (?=(?:{UNITS})\b|%|±|×)|(?<=±) (?=[\d-])|(?<=×) (?=tolerance)|(?<=&lt;) (?=\d)"
)
"""The spaces between a number, its standard deviation and its unit."""
NO_BREAK = "\N{NO-BREAK SPACE}"


COMMAND = re.compile("`([^`]+)`")
"""A command in a sentence."""
COLOURS = {Trust.TRUSTED: "good", Trust.CARE: "care", Trust.DO_NOT_USE: "bad"}
"""The class of a header, which gives its colour."""


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
    lead = "".join(f"<li>{sentence_html(sentence)}</li>" for sentence in summary.sentences)
    verdict = summary.verdict
    body = "".join(
        f'<section id="{section.name}"><h2'
        f' id="{section.name}-title">{escape(section.title)}</h2>{section.html}</section>'
        for section in sections
    )
    notes = "".join(f"<p>Note: {sentence_html(note)}</p>" for note in verdict.notes)
    header = f"""<p class="over">Calibration report, Refracal {VERSION}</p>
<h1>{escape(verdict.headline.removesuffix("."))}</h1>
{tiles_html(summary.tiles)}
{_reasons_html(verdict)}{notes}
<ul class="lead">{lead}</ul>
{commands_html(verdict)}
<nav>{contents}</nav>
<noscript><p>The figures need JavaScript, which this browser does not run. The verdict, the tables
and the pictures are here without it.</p></noscript>"""
    return document(
        f"Calibration of {escape(subject)}",
        style,
        header,
        body,
        colour=COLOURS[verdict.word],
        scripts=scripts,
    )


def commands_html(verdict: Verdict) -> str:
    """Return the commands to type (`Verdict.labelled_commands`), with a note on HOLDOUT
    below the first of them that names that folder.
    """
    note = f'<p class="note">{TESTED_NOTE if verdict.is_tested else HOLDOUT_NOTE}</p>'
    paragraphs = []
    for label, command in verdict.labelled_commands(verdict.further):
        words = shlex.split(command)
        kind = next_class(verdict) if command == verdict.next else "command"
        if words[:2] == ["calib", "report"]:  # it would open this page
            paragraphs.append(f'<p class="{kind}">{label}: look at the figures below.</p>')
            continue
        code = f"<code>{command_html(pasted(words))}</code>"
        paragraphs.append(f'<p class="{kind}">{label}: {code}</p>')
        if HOLDOUT in words and note not in paragraphs:
            paragraphs.append(note)
    return "\n".join(paragraphs)


def next_class(verdict: Verdict) -> str:
    """Return the classes of the next command. A phone shows it below the verdict. A fit that is
    repeated stays below the reasons, because they say what to change first.
    """
    return "command next" if verdict.next_label == NEXT else "command repeat"


def sentence_html(sentence: str) -> str:
    """Return a sentence, and a command between backquotes as code."""
    return COMMAND.sub(r"<code>\1</code>", escape(sentence))


def _reasons_html(verdict: Verdict) -> str:
    """Return the reasons. Of a calibration that must not be used, those that forbid it are bold,
    and the others, which they may explain, are folded.
    """
    grave = [reason for reason in verdict.reasons if reason.word is Trust.DO_NOT_USE]
    further = [reason for reason in verdict.reasons if reason not in grave]
    lines = [f"<li><strong>{sentence_html(reason.capitalised)}</strong></li>" for reason in grave]
    items = [f"<li>{sentence_html(reason.capitalised)}</li>" for reason in further]
    if not grave or not further:
        return f'<ul class="reasons">{"".join(lines + items)}</ul>' if verdict.reasons else ""
    return (
        f'<ul class="reasons">{"".join(lines)}</ul><details class="reasons"><summary>Further'
        f" reasons, which this may explain</summary><ul>{''.join(items)}</ul></details>"
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
    title: str, style: str, header: str, body: str, *, colour: str, scripts: Scripts | None = None
) -> str:
    """Return an HTML file that loads nothing from outside.

    Args:
        title: HTML, as are header and body.
        colour: the class of the header, one of COLOURS.
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
<header class="{colour}">
{keep_numbers(header)}
</header>
<main>{keep_numbers(body)}{scripts.html if scripts else ""}</main>
</body>
</html>
"""

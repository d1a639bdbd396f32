"""The page in a real browser: no console error, every figure and picture drawn, every text readable
on light and on dark.
"""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import pytest
import yaml

from calib.calibration import Calibration
from calib.corners.view import RejectedPicture
from calib.diagnosis.requested_effects import with_requested
from calib.fit_record.history import DiagnosisRecord, DiagnosisRun, History
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.progress import Silent
from calib.session.session import read_session
from fixtures.synthetic import scene
from tests.report.conftest import Reported
from tests.report.made import report_in
from tests.test_calibration import write_session

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-logging=stderr",
    "--window-size=1200,900",
)
DARK = ("--blink-settings=preferredColorScheme=0",)
READABLE = 4.5
"""Contrast of small text, by the Web Content Accessibility Guidelines 2."""
LOOK = """<pre id="seen"></pre><script>
const box = e => { const r = e.getBoundingClientRect(); return Math.min(r.width, r.height); };
const all = (where, what) => [...where.querySelectorAll(what)];
const light = c => c.match(/[0-9.]+/g).slice(0, 3).map(v => v / 255).map(v => v <= .03928 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4)
  .reduce((sum, v, i) => sum + v * [.2126, .7152, .0722][i], 0);
const page = light(getComputedStyle(document.body).backgroundColor);
const contrast = c => { const [a, b] = [light(c), page].sort((x, y) => y - x); return (a + .05) / (b + .05); };
document.getElementById("seen").textContent = JSON.stringify({
  ground: page,
  figures: Object.fromEntries(all(document, "figure svg").map(svg => [svg.closest("section").id, {
    box: box(svg),
    shapes: all(svg, "path, use").filter(e => { const b = e.getBoundingClientRect(); return b.width + b.height > 0; }).length,
    texts: all(svg, "text").length, rasters: all(svg, "image").map(box),
    outside: all(svg, "text").filter(e => { const r = e.getBoundingClientRect(), s = svg.getBoundingClientRect();
      return r.left < s.left - 1 || r.right > s.right + 1 || r.top < s.top - 1 || r.bottom > s.bottom + 1; }).map(e => e.textContent),
    contrast: Math.min(...all(svg, "text").filter(e => /[a-z0-9]/i.test(e.textContent))
      .map(e => contrast(getComputedStyle(e).fill))) }])),
  pictures: all(document, ".view .shot").map(e => box(e)),
  loaded: all(document, ".view .shot img").map(e => e.naturalWidth),
  pair: all(document, ".pair .shot").map(e => [box(e), e.querySelector("img").naturalWidth, e.querySelectorAll("path").length]),
  words: Math.min(...all(document, "p, h1, h2, td, th, a, li, figcaption, small").map(e => contrast(getComputedStyle(e).color))),
  wide: document.documentElement.scrollWidth - window.innerWidth });
</script></body>"""  # noqa: E501

pytestmark = pytest.mark.skipif(
    CHROMIUM is None,
    reason="Chromium is not installed: apt-get install chromium shows the report to these tests",
)


def browse(html: str, folder: Path, *flags: str) -> tuple[str, list[str]]:
    """The page's final HTML, and what its console said."""
    assert CHROMIUM
    (folder / "page.html").write_text(html)
    address = (folder / "page.html").as_uri()
    command = [
        CHROMIUM,
        *FLAGS,
        *flags,
        f"--user-data-dir={folder / 'profile'}",
        "--dump-dom",
        address,
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout, [line for line in done.stderr.splitlines() if ":CONSOLE" in line]


def look(html: str, folder: Path, *flags: str) -> dict[str, Any]:
    without_policy = re.sub(
        r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", html
    )  # it forbids the script that looks
    shown, console = browse(without_policy.replace("</body>", LOOK), folder, *flags)
    assert console == []
    match = re.search(r'<pre id="seen">(.*?)</pre>', shown, re.DOTALL)
    assert match
    report: dict[str, Any] = json.loads(unescape(match[1]))
    return report


def test_the_browser_console_stays_empty(reported: Reported, tmp_path: Path) -> None:
    assert browse(reported.html, tmp_path)[1] == []


@pytest.mark.parametrize(
    "spoilt", ["<img src='http://192.0.2.1/x.png'>", "<script>null.x</script>"]
)
def test_an_error_would_appear_in_the_browser_console(
    reported: Reported, tmp_path: Path, spoilt: str
) -> None:
    assert browse(reported.html.replace("</body>", f"{spoilt}</body>"), tmp_path)[1]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_figure_is_drawn_and_readable(
    reported: Reported, tmp_path: Path, scheme: str
) -> None:
    report = look(reported.html, tmp_path, *(DARK if scheme == "dark" else ()))
    assert (report["ground"] < 0.02) == (scheme == "dark")
    assert list(report["figures"]) == [
        "board-errors",
        "residuals",
        "distortion",
        "by-depth",
        "glass",
        "sigma",
        "coverage",
    ]
    for name, figure in report["figures"].items():
        assert figure["box"] > 150, name
        assert figure["shapes"] > 20, name
        assert figure["texts"] > 10, name
        assert figure["rasters"], name
        assert all(size > 4 for size in figure["rasters"]), name
        assert figure["contrast"] >= READABLE, name
        assert figure["outside"] == [], name
    assert len(report["pictures"]) == 45
    assert min(report["pictures"]) > 100
    assert report["loaded"] == [300] * 45
    assert [pair[1:] for pair in report["pair"]] == [[640, 3]] * 2
    assert min(pair[0] for pair in report["pair"]) > 300
    assert report["words"] >= READABLE
    assert report["wide"] <= 0


PHONE = 390
"""px: of most telephones.

Chromium's own window is at least 500 wide, a frame inside it may be narrower.
"""
MEASURE = """<body style="margin: 0"><iframe style="width: 390px; height: 844px; border: 0"></iframe><pre id="seen"></pre><script>
const frame = document.querySelector("iframe"), html = JSON.parse(document.getElementById("html").textContent);
frame.onload = () => {
  const page = frame.contentDocument, all = what => [...page.querySelectorAll(what)];
  const boxed = e => /auto|scroll|hidden/.test(frame.contentWindow.getComputedStyle(e).overflowX);
  const scrolls = e => e && e !== page.body && (boxed(e) || scrolls(e.parentElement));
  const out = e => { const r = e.getBoundingClientRect(); return r.right > 390.5 || r.left < -0.5; };
  document.getElementById("seen").textContent = JSON.stringify({
    width: frame.contentWindow.innerWidth,
    page: page.documentElement.scrollWidth,
    out: all("body *").filter(e => out(e) && !scrolls(e.parentElement)).map(e => e.tagName + " " + e.textContent.slice(0, 40)),
    tables: all("table").length, cut: all("table").filter(e => out(e) || e.parentElement.scrollWidth > e.parentElement.clientWidth).length,
    narrow: Math.min(...all("td > div").map(e => e.clientWidth)),
    commands: all("pre").filter(e => e.scrollWidth > e.clientWidth).length });
};
frame.srcdoc = html;
</script></body>"""  # noqa: E501


def on_a_phone(html: str, folder: Path) -> dict[str, Any]:
    without_policy = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", html)
    html_text = json.dumps(without_policy).replace("</", "<\\/")
    shown, _ = browse(
        f'<!doctype html><script id="html" type="application/json">{html_text}</script>{MEASURE}',
        folder,
    )
    match = re.search(r'<pre id="seen">(.+?)</pre>', shown, re.DOTALL)
    assert match, "the frame was not measured"
    report: dict[str, Any] = json.loads(unescape(match[1]))
    assert report["width"] == PHONE
    return report


@pytest.fixture(scope="module")
def pages(
    reported: Reported, small_calibration: Calibration, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, str]:
    """Return the pages of a fit, of a diagnosed calibration whose session is gone, and of a camera
    without a cover.
    """
    folder = tmp_path_factory.mktemp("pages")
    tables: list[dict[str, object]] = [
        {
            "effect": name,
            "accepted": True,
            "held_out_px_before": 0.3,
            "held_out_px_after": 0.1,
            "parameters": {},
        }
        for name in ("cover_offset", "board_shape")
    ]
    fitted = with_requested(small_calibration, ("cover_offset", "board_shape"), Silent())
    run = DiagnosisRun("/" + 30 * "far", "/held out")
    diagnosed = replace(
        fitted,
        history=History(diagnosis=DiagnosisRecord({"candidates": tables}), diagnosis_runs=(run,)),
        rejected=(RejectedPicture(30 * "name" + ".png", "its board is not whole"),),
    )
    lens = scene(7, views=8, noise=0.05)
    session = write_session(folder / "session", lens)
    document = yaml.safe_load((session / "session.yaml").read_text())
    (session / "session.yaml").write_text(yaml.safe_dump(document | {"cover": {"shape": "none"}}))
    bare = fit(read_session(session), Settings(), Silent())
    (folder / "bare").mkdir()
    return {
        "fit": reported.html,
        "diagnosed": report_in(folder, diagnosed).read_text(),
        "bare": report_in(folder / "bare", bare).read_text(),
    }


@pytest.mark.parametrize("kind", ["fit", "diagnosed", "bare"])
def test_nothing_is_cut_on_a_phone(pages: dict[str, str], tmp_path: Path, kind: str) -> None:
    """Tables stand below each other and commands wrap; figures alone scroll, each in its own
    box.
    """
    report = on_a_phone(pages[kind], tmp_path)
    assert report["page"] <= PHONE
    assert report["out"] == []
    assert report["tables"] >= 3
    assert report["cut"] == 0
    assert report["commands"] == 0
    assert report["narrow"] > 100, "room for a number with its unit"


def test_a_table_that_does_not_fit_would_have_been_noticed(
    pages: dict[str, str], tmp_path: Path
) -> None:
    assert (
        on_a_phone(pages["fit"].replace("(max-width: 40rem)", "(max-width: 1px)"), tmp_path)["cut"]
        > 0
    )

"""The page in a real browser: no console error, every figure and picture drawn, every text readable on light and on dark."""

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

import pytest

from tests.report.conftest import Reported

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
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
  pictures: all(document, ".shot").map(e => box(e)),
  loaded: all(document, ".shot img").map(e => e.naturalWidth),
  words: Math.min(...all(document, "p, h1, h2, td, th, a, li, figcaption, small").map(e => contrast(getComputedStyle(e).color))),
  wide: document.documentElement.scrollWidth - window.innerWidth });
</script></body>"""

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is not installed: apt-get install chromium shows the report to these tests"
)


def browse(html: str, folder: Path, *flags: str) -> tuple[str, list[str]]:
    """The page's final HTML, and what its console said."""
    assert CHROMIUM
    (folder / "page.html").write_text(html)
    address = (folder / "page.html").as_uri()
    command = [CHROMIUM, *FLAGS, *flags, f"--user-data-dir={folder / 'profile'}", "--dump-dom", address]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout, [line for line in done.stderr.splitlines() if ":CONSOLE" in line]


def look(html: str, folder: Path, *flags: str) -> dict[str, Any]:
    without_policy = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", html)  # it forbids the script that looks
    shown, console = browse(without_policy.replace("</body>", LOOK), folder, *flags)
    assert console == []
    found = re.search(r'<pre id="seen">(.*?)</pre>', shown, re.DOTALL)
    assert found
    seen: dict[str, Any] = json.loads(unescape(found[1]))
    return seen


def test_the_console_says_nothing(reported: Reported, tmp_path: Path) -> None:
    assert browse(reported.html, tmp_path)[1] == []


@pytest.mark.parametrize("spoilt", ["<img src='http://192.0.2.1/x.png'>", "<script>null.x</script>"])
def test_the_console_would_have_said_something(reported: Reported, tmp_path: Path, spoilt: str) -> None:
    assert browse(reported.html.replace("</body>", f"{spoilt}</body>"), tmp_path)[1]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_figure_is_drawn_and_readable(reported: Reported, tmp_path: Path, scheme: str) -> None:
    seen = look(reported.html, tmp_path, *(DARK if scheme == "dark" else ()))
    assert (seen["ground"] < 0.02) == (scheme == "dark")
    assert list(seen["figures"]) == ["board-errors", "residuals", "distortion", "by-depth", "glass", "sigma", "coverage"]
    for name, figure in seen["figures"].items():
        assert figure["box"] > 150, name
        assert figure["shapes"] > 20, name
        assert figure["texts"] > 10, name
        assert figure["rasters"], name
        assert all(size > 4 for size in figure["rasters"]), name
        assert figure["contrast"] >= READABLE, name
        assert figure["outside"] == [], name
    assert len(seen["pictures"]) == 45
    assert min(seen["pictures"]) > 100
    assert seen["loaded"] == [300] * 45
    assert seen["words"] >= READABLE
    assert seen["wide"] <= 0


def test_a_narrow_screen_scrolls_figures_not_the_page(reported: Reported, tmp_path: Path) -> None:
    assert look(reported.html, tmp_path, "--window-size=500,900")["wide"] <= 0

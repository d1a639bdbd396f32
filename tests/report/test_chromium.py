"""The page in a real browser, at a desk and on a phone: no console error and no request, every
figure drawn and readable, every chart answering to the pointer, and nothing from a file that runs.
"""

import json
import re
import threading
from collections.abc import Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("aiohttp", reason="the extra `serve`, which drives Chromium, is not installed")

from calib.apply.map_uncertainty import map_sigmas
from calib.calibration import Calibration
from calib.corners.view import RejectedPicture
from calib.diagnosis.requested_effects import with_requested
from calib.fit_record.history import DiagnosisRecord, DiagnosisRun, History
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.progress import Silent
from calib.report.evidence import gather_evidence
from calib.report.page import page
from calib.report.scripts import Scripts
from calib.report.summary import Summary
from calib.report.tiles import Tile
from calib.report.views import OPEN_VIEWS
from calib.rounding import two_digits
from calib.session.session import read_session
from calib.verdict.verdict import Reason, Verdict
from capture.offered_files import HEADERS
from fixtures.synthetic import scene
from tests.capture.tui.browser import CHROMIUM
from tests.report.chrome import (
    DESK,
    DOT,
    DRAWN,
    LOADED,
    PHONE,
    PLACE,
    RAYS,
    Chrome,
    Page,
    open_chrome,
)
from tests.report.conftest import Reported
from tests.report.made import report_in
from tests.test_calibration import write_session

each_size = pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
READABLE = 4.5
"""Contrast of small text, by the Web Content Accessibility Guidelines 2."""
FIGURES = [
    "scene",
    "coverage",
    "sigma",
    "residuals",
    "board-errors",
    "side-view",
    "distortion",
    "by-depth",
    "glass",
]
LOOK = """(() => {
const box = e => { const r = e.getBoundingClientRect(); return Math.min(r.width, r.height); };
const all = (where, what) => [...where.querySelectorAll(what)];
const light = c => c.match(/[0-9.]+/g).slice(0, 3).map(v => v / 255).map(v => v <= .03928 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4)
  .reduce((sum, v, i) => sum + v * [.2126, .7152, .0722][i], 0);
const page = light(getComputedStyle(document.body).backgroundColor);
const contrast = c => { const [a, b] = [light(c), page].sort((x, y) => y - x); return (a + .05) / (b + .05); };
const wide = document.documentElement.clientWidth;
const boxed = e => /auto|scroll|hidden/.test(getComputedStyle(e).overflowX);
const scrolls = e => e && e !== document.body && (boxed(e) || scrolls(e.parentElement));
const out = e => { const r = e.getBoundingClientRect(); return r.right > wide + .5 || r.left < -.5; };
return {
  ground: page,
  figures: Object.fromEntries(all(document, "figure").map(figure => [figure.closest("section").id, {
    charts: all(figure, ".chart > svg").map(box), canvases: all(figure, "canvas").map(box),
    shapes: all(figure, "path, rect, image").length, texts: all(figure, "svg text").length,
    contrast: Math.min(21, ...all(figure, "svg text").filter(e => /[a-z0-9]/i.test(e.textContent))
      .map(e => contrast(getComputedStyle(e).fill))) }])),
  pictures: all(document, ".view .shot").map(e => e.checkVisibility() ? box(e) : 0),
  loaded: all(document, ".view .shot img").map(e => e.naturalWidth),
  pair: all(document, ".pair .shot").map(e => [box(e), e.querySelector("img")?.naturalWidth ?? 0, e.querySelectorAll("path").length]),
  words: Math.min(...all(document, "p, h1, h2, td, th, a, li, figcaption, small, button, label").filter(e => e.offsetParent)
    .map(e => contrast(getComputedStyle(e).color))),
  page: document.documentElement.scrollWidth - wide,
  out: all(document, "body *").filter(e => e.tagName !== "SCRIPT" && !e.closest("svg") && out(e) && !scrolls(e.parentElement))
    .map(e => e.tagName + " " + e.textContent.slice(0, 40)),
  tables: all(document, "table").length,
  cut: all(document, "table").filter(e => out(e) || e.parentElement.scrollWidth > e.parentElement.clientWidth).length,
  narrow: Math.min(...all(document, ":not(#numbers *) > td > div").map(e => e.clientWidth)),
  lines: all(document, ".option, .key:not(.legend) span").filter(e => e.checkVisibility() && e.getBoundingClientRect().height > 30)
    .map(e => e.textContent),
  keys: all(document, "#glass .panels .key").length,
  wrapped: all(document, "#numbers td > div").filter(e => e.clientHeight > 40).map(e => e.textContent),
  commands: all(document, "pre").filter(e => e.scrollWidth > e.clientWidth).length };
})()"""  # noqa: E501
OVERLAPS = """[...document.querySelectorAll(".chart > svg")].flatMap(svg => {
const texts = [...svg.querySelectorAll("text")].filter(e => e.textContent.trim()), frame = svg.getBoundingClientRect();
const boxes = texts.map(e => ({words: e.textContent, box: e.getBoundingClientRect()}));
const where = svg.closest("section").id;
const shared = (a, b, low, high) => Math.min(a[high], b[high]) - Math.max(a[low], b[low]);
const over = boxes.flatMap((one, place) => boxes.slice(place + 1)
  .filter(other => Math.min(shared(one.box, other.box, "left", "right"), shared(one.box, other.box, "top", "bottom")) > 2)
  .map(other => `${where}: ${one.words} over ${other.words}`));
return [...over, ...boxes.filter(({box}) => box.left < frame.left - 2 || box.right > frame.right + 2).map(({words}) => `${where}: ${words} outside`)];
})"""  # noqa: E501
"""The labels of charts that share more than 2 px with another one, or leave their chart."""
FIELD_REACH = """Math.max(...fieldBorders(DATA.figures.scene, DATA.figures.scene.reach[1]).flat()
  .map(([x, y, z]) => new Libraries.THREE.Vector3(x, -y, -z).project(document.querySelector(".scene").camera))
  .flatMap(({x, y}) => [Math.abs(x), Math.abs(y)]))"""  # noqa: E501
"""The largest distance of the border of what the camera sees from the scene's middle, in halves of
the scene's width or height.
"""
TOPS = """Object.fromEntries(Object.entries({h1: "h1", next: ".next, .repeat", reasons: ".reasons", tiles: ".tiles"})
  .map(([name, what]) => [name, document.querySelector(what).getBoundingClientRect().top]))"""  # noqa: E501
"""The distances of elements from the top of the page, px."""
CAMERA = "document.querySelector('.scene').camera.position.toArray()"
TITLE = "document.querySelector('#sigma .panel-title').textContent"

CORNER_PANELS = (
    "#board-errors .panel:last-of-type",
    "#residuals .panel:nth-of-type(3)",
    "#coverage .panel:last-of-type",
)
CORNER = r"corner in column \d, row \d.*error [\d.]+ px"

pytestmark = pytest.mark.skipif(
    CHROMIUM is None,
    reason="Chromium is not installed: apt-get install chromium shows the report to these tests",
)


@pytest.fixture(scope="module")
def chrome(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    with open_chrome(tmp_path_factory.mktemp("profile")) as browser:
        yield browser


async def looks(page: Page) -> dict[str, Any]:
    report: dict[str, Any] = await page.call(LOOK)
    return report


async def nothing(page: Page) -> None:
    await page.call("0")


@pytest.mark.parametrize("scheme", [pytest.param("light", marks=pytest.mark.slow), "dark"])
def test_every_figure_is_drawn_and_readable(
    chrome: Chrome, reported: Reported, tmp_path: Path, scheme: str
) -> None:
    report, complaints, requests = chrome.read(reported.html, tmp_path, looks, scheme=scheme)
    assert (complaints, requests) == ([], [])
    assert (report["ground"] < 0.02) == (scheme == "dark")
    assert list(report["figures"]) == FIGURES
    for name, figure in report["figures"].items():
        drawn = figure["canvases"] if name == "scene" else figure["charts"]
        assert drawn, name
        assert min(drawn) > 150, name
        if name != "scene":
            assert figure["shapes"] > 10, name
            assert figure["texts"] > 10, name
        assert figure["contrast"] >= READABLE, name
    assert len(report["pictures"]) == 45
    assert min(report["pictures"][:OPEN_VIEWS]) > 100
    assert max(report["pictures"][OPEN_VIEWS:]) == 0, "until a click"
    assert len(report["loaded"]) == 45
    assert min(report["loaded"]) > 180, "px, of grainy pictures"
    assert [pair[2] for pair in report["pair"]] == [2, 2], "straight lines, and corners"
    assert min(pair[1] for pair in report["pair"]) > 400, "px, of a grainy picture"
    assert min(pair[0] for pair in report["pair"]) > 300
    assert report["words"] >= READABLE
    assert report["page"] <= 0
    assert report["keys"] == 2, "the heights and their standard deviations have scales of their own"


@pytest.mark.parametrize(
    ("command", "order"),
    [("calib diagnose out", ["h1", "next", "reasons"]), ("calib fit s", ["h1", "reasons", "next"])],
)
def test_a_phone_shows_the_next_command_without_scrolling(
    chrome: Chrome, tmp_path: Path, command: str, order: list[str]
) -> None:
    """Below the verdict; a fit that is repeated has to wait for the reason, which is to be mended
    first.
    """
    reasons = tuple(Reason(f"{8 * 'the views contradict it '}.", command) for _ in range(2))
    tiles = tuple(Tile("error of the fitted views", "0.1 px") for _ in range(5))
    summary = Summary(("A camera.",), Verdict(reasons, ""), tiles)
    html = page("out", summary, [], Scripts("", "'none'"))

    async def tops(shown: Page) -> dict[str, float]:
        measured: dict[str, float] = await shown.call(TOPS)
        return measured

    places, _, _ = chrome.read(html, tmp_path, tops, PHONE, ready=LOADED)
    assert sorted(order, key=lambda name: places[name]) == order
    assert max(places[name] for name in order) < min(places["tiles"], PHONE[1])


@pytest.mark.parametrize(
    "spoilt", ["<img src='http://192.0.2.1/x.png'>", "<script>window.ran = 1</script>"]
)
def test_what_the_policy_forbids_does_not_happen_and_would_be_noticed(
    chrome: Chrome, reported: Reported, tmp_path: Path, spoilt: str
) -> None:
    """Also the negative control of the tests that find no complaint."""
    html = reported.html.replace("</main>", f"{spoilt}</main>")

    async def ran(page: Page) -> object:
        return await page.call("window.ran ?? null")

    result, complaints, _ = chrome.read(html, tmp_path, ran)
    assert result is None
    assert any("Content Security Policy" in complaint for complaint in complaints)


async def overlaps(page: Page) -> list[str]:
    found: list[str] = await page.call(OVERLAPS)
    return found


@each_size
def test_no_label_of_a_chart_lies_over_another(
    chrome: Chrome, reported: Reported, tmp_path: Path, size: tuple[int, int]
) -> None:
    assert chrome.read(reported.html, tmp_path, overlaps, size)[0] == []


def test_labels_over_each_other_would_have_been_noticed(
    chrome: Chrome, reported: Reported, tmp_path: Path
) -> None:
    html = reported.html.replace("<style>", "<style>.levels text { font-size: 60px; }")
    assert chrome.read(html, tmp_path, overlaps)[0]


@pytest.mark.parametrize(
    "size", [pytest.param(DESK, marks=pytest.mark.slow), PHONE], ids=["desk", "phone"]
)
def test_the_figures_answer_to_the_pointer(
    chrome: Chrome, reported: Reported, tmp_path: Path, size: tuple[int, int]
) -> None:
    async def story(page: Page) -> None:
        x, y = await page.middle(".scene canvas")
        position = await page.call(CAMERA)
        await page.drag(x, y, 80, 10)
        assert await page.call(CAMERA) != position, "the scene turned"
        await page.call("document.querySelectorAll('.scene')[0].previousSibling.firstChild.click()")
        for step in range(-8, 9):  # boards stand about the middle of the scene
            place = x + 12 * step, y + 6 * step
            await page.mouse("mouseMoved", *place)
            if await page.call(RAYS):
                break
        assert await page.call(RAYS) > 10, "rays of a board under the pointer"
        await page.click(*place)
        assert await page.until("document.getElementById('viewer').open"), "the board's picture"
        await page.call("document.getElementById('viewer').close()")

        for panel in CORNER_PANELS:
            text = await page.hover(panel)
            assert re.search(CORNER, text, re.DOTALL), panel

        title = await page.call(TITLE)
        sigmas = map_sigmas(reported.calibration, gather_evidence(reported.calibration).depths)
        printed = [f"{two_digits(sigma)} px" for sigma in sigmas.values()]
        shown = re.search(r": (\S+\spx), median", title)
        assert shown
        assert shown[1].replace("\N{NO-BREAK SPACE}", " ") in printed, "those of the terminal"
        x, y, width, height = await page.call(PLACE.format(what="#sigma .slider input"))
        await page.click(x + 0.8 * width, y + height / 2)
        changed = await page.until(f"{TITLE} !== {json.dumps(title)}")
        assert changed, "another depth, another sigma"

        await page.hover("#board-errors .chart")
        await page.click(*await page.call(DOT.format(what="#board-errors .chart")))
        assert await page.until("document.getElementById('viewer').open"), "the corner's picture"
        assert await page.until("document.querySelectorAll('#viewer .dots path').length > 5")

    _, complaints, requests = chrome.read(reported.html, tmp_path, story, size)
    assert (complaints, requests) == ([], [])


@each_size
def test_the_lines_of_the_scene_have_names(
    chrome: Chrome, reported: Reported, tmp_path: Path, size: tuple[int, int]
) -> None:
    """The camera's own stands beside it, from everywhere."""
    name = """(() => { const e = document.querySelector(".scene-name"), r = e.getBoundingClientRect();
const box = e.parentElement.getBoundingClientRect();
return !e.hidden && r.left >= box.left && r.right <= box.right && r.bottom <= box.bottom ? e.textContent : null; })()"""  # noqa: E501

    async def story(page: Page) -> list[str]:
        buttons = "document.querySelectorAll('#scene .buttons button')"
        for place in range(await page.call(f"{buttons}.length")):
            await page.call(f"{buttons}[{place}].click()")
            assert await page.call(name) == "camera", place
            if await page.call(f"{buttons}[{place}].textContent") != "cover":
                assert await page.call(FIELD_REACH) < 1, "of half the scene's width and height"
        texts: list[str] = await page.call(
            "[...document.querySelectorAll('.legend span')].map(entry => entry.textContent)"
        )
        return texts

    names, complaints, _ = chrome.read(reported.html, tmp_path, story, size)
    assert names == [
        "border of what the camera sees",
        "optical axis, with the distance from the lens",
        "cover",
        "rays to the board that you point at",
    ]
    assert complaints == []


@pytest.mark.slow
def test_a_chart_zooms_with_the_wheel_after_a_click(
    chrome: Chrome, reported: Reported, tmp_path: Path
) -> None:
    """Before the click, the wheel scrolls the page."""
    ticks = "document.querySelector('#glass .chart svg').textContent"

    async def story(page: Page) -> None:
        x, y = await page.middle("#glass .chart")
        whole = await page.call(ticks)
        await page.mouse("mouseMoved", x, y)
        turn = {"type": "mouseWheel", "x": x, "y": y, "deltaX": 0, "deltaY": -240}
        await page.click(x, y)
        await page.do("Input.dispatchMouseEvent", **turn)
        assert await page.until(f"{ticks} !== {json.dumps(whole)}")
        await page.call("document.querySelector('#glass .reset').click()")
        assert await page.until(f"{ticks} === {json.dumps(whole)}")

    assert chrome.read(reported.html, tmp_path, story)[1:] == ([], [])


@pytest.mark.slow
def test_a_browser_without_3d_says_so_and_draws_the_rest(
    chrome: Chrome, small_calibration: Calibration, tmp_path: Path
) -> None:
    """As with a remote desktop or an old graphics driver."""
    without = """const get = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return kind.startsWith("webgl") ? null : get.call(this, kind, ...more); };"""

    async def story(page: Page) -> str:
        added = await page.do("Page.addScriptToEvaluateOnNewDocument", source=without)
        await page.call("delete document.documentElement.dataset.drawn")
        await page.do("Page.reload")
        drawn = await page.until(DRAWN)
        await page.do("Page.removeScriptToEvaluateOnNewDocument", identifier=added["identifier"])
        assert drawn
        assert await page.call("document.querySelectorAll('#side-view svg').length") >= 2
        return str(await page.call("document.getElementById('scene').textContent"))

    html = report_in(tmp_path, small_calibration).read_text()
    text, complaints, _ = chrome.read(html, tmp_path, story)
    assert "draws no 3D" in text
    assert complaints == []


HOSTILE = "</script><script>window.ran=1</script><img src=x onerror='window.ran=2'>&lt;script&gt;"


def test_names_and_models_run_nothing(
    chrome: Chrome, small_calibration: Calibration, tmp_path: Path
) -> None:
    """They stand in the page as text: in the tables, in the scripts' data and in what hovers."""
    views = tuple(
        replace(view, name=f"{number}{HOSTILE}.png")
        for number, view in enumerate(small_calibration.views)
    )
    camera = replace(small_calibration.camera, model=HOSTILE)
    html = report_in(tmp_path, replace(small_calibration, views=views, camera=camera)).read_text()

    async def story(page: Page) -> tuple[object, str]:
        await page.call("openView(3)")
        text = await page.hover("#viewer")
        return await page.call("window.ran ?? null"), text

    (ran, text), complaints, requests = chrome.read(html, tmp_path, story)
    assert ran is None
    assert "<script>window.ran=1" in text
    assert (complaints, requests) == ([], [])


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


@pytest.mark.parametrize("kind", [pytest.param("fit", marks=pytest.mark.slow), "diagnosed", "bare"])
def test_nothing_is_cut_on_a_phone(
    chrome: Chrome, pages: dict[str, str], tmp_path: Path, kind: str
) -> None:
    """Tables stand below each other, and commands wrap."""
    report, complaints, requests = chrome.read(pages[kind], tmp_path, looks, PHONE)
    assert (complaints, requests) == ([], [])
    assert report["page"] <= 0
    assert report["out"] == []
    assert report["tables"] >= 3
    assert report["cut"] == 0
    assert report["commands"] == 0
    assert report["narrow"] > 100, "room for a number with its unit"
    assert report["wrapped"] == [], "a number is in one line"
    assert report["lines"] == [], "an option, and a colour's number, are in one line"


def test_a_table_that_does_not_fit_would_have_been_noticed(
    chrome: Chrome, pages: dict[str, str], tmp_path: Path
) -> None:
    html = pages["fit"].replace("(max-width: 40rem)", "(max-width: 1px)")
    assert chrome.read(html, tmp_path, looks, PHONE)[0]["cut"] > 0


def test_without_scripts_the_verdict_and_the_tables_are_there(
    chrome: Chrome, reported: Reported, tmp_path: Path
) -> None:
    html = re.sub(r"script-src [^;\"]*", "script-src 'none'", reported.html)

    async def story(page: Page) -> dict[str, Any]:
        await page.click(*await page.middle(".more summary"))
        assert await page.until("document.querySelector('.more').open")
        return await looks(page)

    report, _, _ = chrome.read(html, tmp_path, story, ready=LOADED)
    assert report["tables"] >= 3
    assert len(report["loaded"]) == 45
    assert min(report["pictures"]) > 100


@pytest.mark.slow
def test_a_report_that_capture_serves_draws_its_figures(chrome: Chrome, reported: Reported) -> None:
    """Its headers put the page into a sandbox, and allow the report's scripts alone."""
    pages = {
        "/report.html": reported.html,
        "/other.html": "<p>a page</p><script>document.title = 'ran'</script>",
    }

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            for name, value in {**HEADERS, "Content-Type": "text/html; charset=utf-8"}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(pages.get(self.path, "").encode())

        def log_message(self, *_: object) -> None:
            pass

    async def title(page: Page) -> object:
        return await page.call("document.title")

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}"
        assert chrome.visit(f"{address}/report.html", looks)[0]["figures"]["sigma"]["charts"]
        assert chrome.visit(f"{address}/other.html", title, ready=LOADED)[0] != "ran"
        server.shutdown()

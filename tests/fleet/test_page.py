"""The outliers in words, on the page and in the table."""

import csv
import io
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="the extra `serve`, which drives Chromium, is not installed")

from calib.fleet.charts import link_of
from calib.fleet.control import ALPHA
from calib.fleet.findings import Fleet, judge_fleet
from calib.fleet.limits import Limit
from calib.fleet.numbers import FleetNumber, PriorShift
from calib.fleet.page import fleet_page, headline
from calib.fleet.result import JobState, Result
from calib.fleet.table import fleet_csv
from fixtures.fleet_results import made, result
from tests.capture.tui.browser import CHROMIUM
from tests.report.chrome import DOT, LOADED, Chrome, Page, open_chrome


def plain(camera: str, **changed: object) -> Result:
    """A camera like the others, but for what is changed."""
    return replace(result(np.random.default_rng(0), camera, moved=True), **changed)  # type: ignore[arg-type]


def measured(name: str, value: float, sigma: float) -> dict[str, FleetNumber]:
    return {**plain("").numbers, name: FleetNumber(value, sigma, "px")}


CHANGE = {"sentence": "the focal length has changed by 3.0 ± 0.1 %", "name": "focal"}
BROKEN = {"answer": "broken", "p_value": 0.0, "added_px": 4.2, "lacking": "", "changes": [CHANGE]}
SHIFTS = {"camera.cx": PriorShift(100.0, 130.0, -30.0, "px")}
LOST = "Its prior could not be checked: x does not exist."
UNITS_DOUBTED: dict[str, Any] = {
    "word": "care",
    "reasons": [
        "the board would be 0.0004 m wide, with squares of 5e-05 m: check board.square_mm, whose"
        " unit is the millimetre.",
        "the views scatter.",
    ],
}
UNITS_NOTED: dict[str, Any] = {
    "word": "trusted",
    "reasons": [],
    "notes": [
        "the board would be 20 mm wide, and every length that you measure depends on it: check"
        " board.square_mm, whose unit is the millimetre."
    ],
}
WAYS: dict[str, tuple[Result, str]] = {
    "c3": (
        Result("c3", JobState.FAILED, "a.png is truncated or damaged: copy it again."),
        "no calibration: a.png is truncated",
    ),
    "c5": (
        plain("c5", numbers=measured("camera.fx", 150.0, 0.3)),
        "focal length, x is 150.00 ± 0.30 px, where the fleet has 99.8",
    ),
    "c7": (
        plain("c7", numbers=measured("noise_px", 0.9, 0.0)),
        "noise of the corners is 8.8 times the fleet's, 0.9 px where",
    ),
    "c9": (
        plain("c9", verdict={"word": "do_not_use", "reasons": ["it is mirrored."]}),
        "not to use it: it is mirrored",
    ),
    "c11": (
        plain("c11", check=BROKEN),
        "its prior is broken: the focal length has changed by 3.0 ± 0.1 %, which adds 4.2 px",
    ),
    "c13": (
        plain("c13", effects=("board_shape",)),
        "its diagnosis found board_shape, which no other has",
    ),
    "c15": (
        plain("c15", shifts=SHIFTS),
        "principal point, x moved by -30.0 sigmas from its prior, 100 to 130 px",
    ),
    "c17": (plain("c17", remarks=(LOST,)), "its prior could not be checked"),
}


@pytest.fixture(scope="module")
def fleet() -> Fleet:
    return made(60, {camera: item for camera, (item, _) in WAYS.items()})


def test_every_fault_is_described_and_nothing_else(fleet: Fleet) -> None:
    assert set(fleet.outliers) == set(WAYS)
    for camera, (_, message) in WAYS.items():
        assert message in fleet.findings[camera][0].sentence, camera
    assert fleet.outliers[:2] == ["c3", "c9"]
    assert headline(fleet) == "8 of 60 cameras stand out"


def test_a_doubted_unit_stands_out() -> None:
    """The reasons and notes that doubt a unit are listed, and no reason of another kind."""
    judged = made(
        60, {"c3": plain("c3", verdict=UNITS_DOUBTED), "c5": plain("c5", verdict=UNITS_NOTED)}
    )
    sentences = {
        camera: [finding.sentence for finding in findings]
        for camera, findings in judged.findings.items()
    }
    assert sentences == {
        "c3": [UNITS_DOUBTED["reasons"][0].rstrip(".")],
        "c5": [UNITS_NOTED["notes"][0].rstrip(".")],
    }


def test_a_fleet_with_small_boards_has_none_that_stands_out() -> None:
    noted = {f"c{number}": plain(f"c{number}", verdict=UNITS_NOTED) for number in range(20)}
    for count, doubted in ((30, 0), (60, 20)):
        findings = (
            finding for listed in made(count, noted).findings.values() for finding in listed
        )
        assert sum("millimetre" in finding.sentence for finding in findings) == doubted


def test_a_fleet_without_a_fault_is_reported_so() -> None:
    judged = made(30)
    assert headline(judged) == "None of 30 cameras stands out"
    assert 'class="good"' in fleet_page(judged, "line 3")


def test_false_alarms_over_charts_priors_and_shifts_have_the_stated_rate() -> None:
    alarms = sum(bool(made(30, seed=seed).findings) for seed in range(100))
    assert alarms <= 100 * ALPHA + 3 * (100 * ALPHA * (1 - ALPHA)) ** 0.5


def test_an_effect_that_many_cameras_have_is_no_outlier() -> None:
    shared = {
        f"c{number}": plain(f"c{number}", effects=("rolling_shutter",)) for number in range(12)
    }
    assert not made(60, shared).findings
    assert "<b>rolling_shutter</b>" in fleet_page(made(60, shared), "x")


def test_a_camera_may_have_a_limit_of_its_own() -> None:
    judged = made(30)
    entries = [
        replace(entry, limits=(Limit("cover.thickness", high=99.0),)) if entry.id == "c4" else entry
        for entry in judged.entries
    ]
    results = {item.id: item for item in judged.results}
    results["c4"] = replace(
        results["c4"],
        numbers={**results["c4"].numbers, "cover.thickness": FleetNumber(100.1, 0.3, "mm")},
    )
    (finding,) = judge_fleet(entries, results).findings["c4"]
    assert finding.sentence == "cover.thickness is 100.1 mm, where its limit is at most 99"


def test_the_page_needs_nothing_and_links_every_camera(fleet: Fleet) -> None:
    html = fleet_page(fleet, "line <3>")
    assert len(re.findall(r"<script[^>]*>", html)) == 3, "its data, the libraries, and what draws"
    content, licences, _ = html.partition("<details><summary>Licences")
    assert licences
    assert not re.search(r"https?://|<script", content.replace("http://www.w3.org", ""))
    assert "line &lt;3&gt;" in html
    assert "SN<" not in html
    for camera in (entry.id for entry in fleet.entries):
        place = f"cameras/{camera}.json" if camera == "c3" else f"cameras/{camera}/report.html"
        assert f'href="{place}"' in html
    assert content.count("<svg") == 1 + len(fleet.charts) + 1
    assert (
        html.index("Who stands out")
        < html.index("Control charts")
        < html.index("Against the priors")
        < html.index("All cameras")
    )


def test_ten_thousand_cameras_are_one_page_of_some_megabytes() -> None:
    large = made(10_000)
    html = fleet_page(large, "large")
    assert len(html) < 12e6
    assert len(large.findings) < 3


def test_the_table_has_a_row_for_each_camera(fleet: Fleet) -> None:
    rows = list(csv.DictReader(io.StringIO(fleet_csv(fleet))))
    assert len(rows) == 60
    by_id = {row["id"]: row for row in rows}
    assert [camera for camera, row in by_id.items() if row["stands_out"] == "1"] == [
        e.id for e in fleet.entries if e.id in WAYS
    ]
    assert by_id["c3"]["state"] == "failed"
    assert by_id["c3"]["camera.fx"] == ""
    assert by_id["c5"]["camera.fx"] == "150"
    assert by_id["c5"]["camera.fx.sigma"] == "0.3"
    assert by_id["c15"]["camera.cx.moved_sigmas"] == "-30.000"
    assert by_id["c5"]["report"] == "cameras/c5/report.html"


@pytest.fixture(scope="module")
def chrome(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    with open_chrome(tmp_path_factory.mktemp("profile")) as browser:
        yield browser


@pytest.mark.skipif(
    CHROMIUM is None,
    reason="Chromium is not installed: apt-get install chromium shows the page to this test",
)
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_in_a_browser(fleet: Fleet, tmp_path: Path, chrome: Chrome, scheme: str) -> None:
    """Nothing is refused, every mark lies in its drawing, and no name covers another."""
    look = """(() => {
const box = e => e.getBoundingClientRect(), all = (w, s) => [...w.querySelectorAll(s)];
const out = all(document, "svg").flatMap(svg => all(svg, "text, circle, path.out").filter(e => { const r = box(e), s = box(svg);
  return r.left < s.left - 1 || r.right > s.right + 1 || r.top < s.top - 1 || r.bottom > s.bottom + 1; }).map(e => e.outerHTML));
const over = all(document, ".charts svg").flatMap(svg => all(svg, ".name").flatMap((a, i, names) => names.slice(i + 1).filter(b => {
  const p = box(a), q = box(b); return p.left < q.right && q.left < p.right && p.top + 3 < q.bottom && q.top + 3 < p.bottom; })
  .map(b => a.textContent + "/" + b.textContent)));
return { out, over, wide: document.documentElement.scrollWidth - window.innerWidth, marks: all(document, "svg .out").length };
})()"""  # noqa: E501

    async def story(page: Page) -> dict[str, Any]:
        findings: dict[str, Any] = await page.call(look)
        return findings

    html = fleet_page(fleet, "line 3")
    static = html.replace("script-src", "script-src 'none';")  # the drawings without scripts
    findings, _, _ = chrome.read(static, tmp_path, story, scheme=scheme, ready=LOADED)
    assert (findings["out"], findings["over"]) == ([], [])
    assert findings["marks"] > 5
    findings, complaints, requests = chrome.read(html, tmp_path, story, scheme=scheme)
    assert (findings["out"], findings["over"]) == ([], [])
    assert findings["wide"] <= 0
    assert findings["marks"] > 5
    assert (complaints, requests) == ([], [])


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed: apt-get install chromium")
def test_a_dot_says_which_camera_it_is(fleet: Fleet, tmp_path: Path, chrome: Chrome) -> None:
    """And its click opens the camera's report."""

    for index, entry in enumerate(fleet.entries):
        report = tmp_path / link_of(fleet, index)
        report.parent.mkdir(parents=True, exist_ok=True)
        report.write_text(f"<title>{entry.id}</title>")

    async def story(page: Page) -> tuple[str, bool]:
        text = await page.hover("#charts .chart")
        await page.click(*await page.call(DOT.format(what="#charts .chart")))
        name = text.replace("\u200b", " ").split()[0]
        return text, await page.until(f"document.title === {name!r}")

    (text, opened), _, _ = chrome.read(fleet_page(fleet, "line 3"), tmp_path, story)
    assert re.search(r"c\d+\W+[\d.]+ px", text)
    assert opened

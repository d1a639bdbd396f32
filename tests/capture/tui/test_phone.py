"""A whole session in Chromium on a telephone's page, by touch alone, as someone with one beside the
camera has it.

`REFRACAL_PICTURES=FOLDER python -m pytest tests/capture/tui/test_phone.py` keeps a picture of every
step there, to be looked at.
"""

import asyncio
import json
import os
from collections.abc import Coroutine
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("textual_serve", reason="the extra `serve` is not installed")

from tests.capture.recordings import write_recording
from tests.capture.rig.pair_recordings import BOARD_FLAGS, SHARED, record, resting
from tests.capture.tui.browser import CHROMIUM
from tests.capture.tui.driving import CONE
from tests.capture.tui.test_serve import Served
from tests.capture.tui.test_session import FIXTURE
from tests.capture.tui.touch import SIZE, VISIBLE, WORDS, Telephone, telephone

COVER = (
    "inner_radius_mm",
    "radius_slope",
    "axis_offset_mm",
    "tilt_deg",
    "thickness_mm",
    "refractive_index",
    "outside_index",
)
HEARD = 'document.getElementById("picture").dataset.heard ?? ""'
OUTSIDE = """
[...document.querySelectorAll("#thumb *")].filter((each) => {
  const {left, right, width} = each.getBoundingClientRect();
  return width && !each.closest("svg") && (left < -0.5 || right > innerWidth + 0.5);
}).map((each) => each.outerHTML.slice(0, 80)).join("\\n")
"""
"""The elements that do not fit into the page's width."""
PICTURE = 'document.querySelector("#picture img").naturalWidth'
LISTEN = """
window.notes = [];
window.spoken = [];
const make = AudioContext.prototype.createOscillator;
AudioContext.prototype.createOscillator = function () {
  const made = make.call(this), start = made.start;
  made.start = (at) => notes.push(made.frequency.value) && start.call(made, at);
  return made;
};
speechSynthesis.speak = (each) => spoken.push(each.text);
"""
"""A script that records the spoken texts."""
THICKNESS = 'document.getElementById("field-thickness_mm")'
SHAPE = 'document.getElementById("choice-shape")'
UNKNOWN = f"{THICKNESS}.parentElement.querySelector('.unknown')"
VERDICT = 'document.querySelector("#dock [data-name=verdict].trusted")'
OUTLINE = 'document.querySelector("#picture .hint:not(.halo)")?.getAttribute("d") ?? ""'

pytestmark = pytest.mark.skipif(
    CHROMIUM is None,
    reason="Chromium is not installed: apt-get install chromium shows it the screen",
)


def tried(story: Coroutine[None, None, None], served: Served) -> None:
    try:
        asyncio.run(story)
    finally:
        served.end()


@pytest.mark.slow
def test_from_nothing_to_maps_by_touch(tmp_path: Path) -> None:
    session = tmp_path / "session"
    served = Served(session)
    tried(_from_nothing(served.address, tmp_path), served)
    with np.load(session / "export" / "map_1m.npz") as maps:
        assert maps["map_x"].shape == (616, 820)


async def _from_nothing(address: str, folder: Path) -> None:
    async with telephone(address, folder / "profile") as phone:
        await phone.see("Where pictures come from")
        await _keep(phone, "1-new")
        labels = (
            "[...document.querySelectorAll('nav button')].map((each) => each.textContent).join()"
        )
        assert await phone.evaluate(labels) == "Start", "Quit, which ends at once, is in the menu"
        await phone.fill("source", f"folder:{FIXTURE / 'bare'}")
        await phone.choose("kind", "checkerboard")
        for name, text in zip(("columns", "rows", "square_mm"), ("9", "9", "20"), strict=True):
            await phone.fill(name, text)
        await phone.choose("shape", "cone")
        for name, text in zip(COVER, CONE, strict=True):
            await phone.fill(name, text)
        await phone.let_go()
        await phone.tap(UNKNOWN)
        await phone.until(f"{THICKNESS}.value === 'unknown'")
        await phone.tap(UNKNOWN)
        await phone.until(f"{THICKNESS}.value === '{CONE[COVER.index('thickness_mm')]}'")
        await phone.tap(UNKNOWN)
        await phone.tap("document.getElementById('more')")
        place = await phone.evaluate_json(f"{SHAPE}.getBoundingClientRect()")
        assert place
        beside = [{"x": place["x"] + 20, "y": place["y"] + 20}]
        await phone.do("Input.dispatchTouchEvent", type="touchStart", touchPoints=beside)
        await phone.do("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        await phone.until("document.getElementById('menu').hidden")
        assert not await phone.evaluate("document.querySelector('.choice ul:not([hidden])')")
        await phone.see("thickness (mm)")
        await _keep(phone, "2-set-up")
        await phone.fill("thickness_mm", CONE[COVER.index("thickness_mm")])
        await phone.fill("square_mm", "20,0")  # the keyboard of many languages has no point
        await phone.do("Input.dispatchKeyEvent", type="keyDown", key="Enter", code="Enter")
        cone = f"{SHAPE}.parentElement.querySelector('ul:not([hidden]) .chosen')"
        await phone.tap(cone)
        await phone.until(f"!{cone}")
        await phone.until("document.getElementById('field-square_mm').value === '20.0'")
        await phone.let_go()
        await phone.press_until("ctrl+s", "Touch Cover on, then put the cover on.")
        await phone.see("Without cover")
        await _keep(phone, "3-without-cover")
        assert await phone.evaluate(PICTURE) == 820
        assert "taken" in str(await phone.evaluate(HEARD))
        await phone.press("n")
        await phone.see("NOW PUT THE COVER ON")
        await phone.fill("source", f"folder:{FIXTURE}")
        await phone.let_go()
        await phone.press_until("ctrl+s", "Touch Fit to fit")
        await phone.see("Through cover")
        await phone.see("Enough")
        maps = json.loads(str(await phone.evaluate(MAPS)))
        assert [(entry["name"], entry["size"]) for entry in maps] == [
            ("image", [12, 9]),
            ("glass", [12, 9]),
            ("depth", [3, 1]),
        ]
        assert [entry["said"].split(" % ")[1] for entry in maps] == ["sure", "enough", "sure"]
        for entry in maps:
            is_full = " 100 % " in entry["said"]
            assert (entry["colours"] == 1) == is_full, "one colour is of what is covered"
        await _keep(phone, "4-through-cover")
        await phone.evaluate(
            "document.querySelector('[data-name=depth]').scrollIntoView({block: 'end'})"
        )
        await _keep(phone, "4-maps")
        assert str(await phone.evaluate(HEARD)).endswith("enough")
        await phone.press("f")
        await phone.see("Loading")  # the page is not empty meanwhile
        await phone.see("Joint fit")
        await _keep(phone, "5-fit")
        await phone.see("The error fell from 0.4")
        await phone.until(VISIBLE % VERDICT)
        await _keep(phone, "6-results")
        for size in SIZES[::-1]:
            await phone.resize(size)
            await phone.tap(f"{VIEWS}[2]")
            await phone.until(VISIBLE % LIVE)
            await _keep(phone, "6-views", size)
            visible = ", ".join(VISIBLE.strip() % f"{VIEWS}[{index}]" for index in range(12))
            await phone.until(f"[{visible}].filter(Boolean).length >= 3")
            for name in ("main .list .chosen", "#caption", "nav .main"):
                await phone.until(VISIBLE % f"document.querySelector('{name}')")
        await phone.tap("document.querySelector('.list .chosen')")
        await phone.tap("document.getElementById('help')")
        await phone.see("A camera behind a cover")
        await _keep(phone, "7-help")
        await phone.press("escape")
        await phone.see("Views, the worst first")
        await phone.until(VISIBLE % "document.querySelector('main [data-name=onward]')")
        assert await phone.evaluate(LINKS) == "", "there is no report yet"
        await phone.press("r")
        await phone.see("The report is written: touch Open the report.")
        await phone.until(f"{LINKS} === 'Open the report'")
        await _keep(phone, "6-report")
        assert await phone.evaluate(FETCH % 0) == "200 text/html"
        await phone.press("e")
        await phone.see("Nothing found")
        assert float(str(await phone.evaluate(LETTERS))) >= 12, "a table of readable letters"
        await _keep(phone, "8-effects")
        await phone.press("escape")
        await phone.press("x")
        await phone.see("Maps that undistort pictures")
        form = 'document.getElementById("choice-form").textContent'
        await phone.until(f"{form}.startsWith('straight')")  # a phone can show these
        await phone.choose("form", "further")
        await phone.see("which form")
        await phone.tap('document.getElementById("choice-form")')
        forms = 'document.getElementById("choice-form").parentElement.querySelector("ul")'
        await phone.until(VISIBLE % forms)  # the forms need no scrolling
        await phone.tap('document.getElementById("choice-form")')
        await phone.choose("form", "npz")
        await phone.fill("depths", "0.5 1")
        await phone.let_go()
        await phone.press("ctrl+s")
        await phone.see("Wrote rays.npz map_0.5m.npz map_1m.npz")
        colours = f"{COLOUR % '#dock [data-name=said]'} === {COLOUR % 'body'}"
        assert await phone.evaluate(colours), "the result is as bright as other text"
        await _keep(phone, "9-export")
        await phone.press("escape")
        await phone.see("Wrote 3 files")
        assert "Download exports" in str(await phone.evaluate(LINKS))
        await _keep(phone, "9-maps")
        assert await phone.evaluate(FETCH % 1) == "200 application/zip"
        await phone.press("escape")
        await phone.see("Touch Results for the results")
        await phone.press("u")
        await phone.see("depth in metres")
        await phone.fill("depth", "0.5")
        await phone.let_go()
        await _keep(phone, "10-depth")
        await phone.press("ctrl+s")
        await phone.see("Undistorted for 0.5 m")
        await phone.until("document.querySelectorAll('#picture .line').length >= 10")
        await _keep(phone, "11-undistorted")
        assert phone.complaints == []


@pytest.mark.slow
def test_the_ghost_board_is_an_outline_over_the_live_picture(tmp_path: Path) -> None:
    """A refusal is heard once; text typed on another screen goes nowhere."""
    picture = cv2.imread(str(next(iter(sorted((FIXTURE / "frames").glob("*.jpg"))))))
    assert picture is not None
    board = np.asarray(picture, np.uint8)
    recording = write_recording(tmp_path / "bare", [board] * 200, interval_s=0.2)
    session = tmp_path / "session"
    session.mkdir()
    (session / "session.yaml").write_text((FIXTURE / "session.yaml").read_text())
    served = Served(session, "--source", f"folder:{recording}?speed=1")
    tried(_ghost(served.address, tmp_path), served)


async def _ghost(address: str, folder: Path) -> None:
    async with telephone(address, folder / "profile") as phone:
        await phone.see("continued, 0 views")
        await phone.evaluate(LISTEN)
        await phone.press("ctrl+s")
        await phone.see("This view is already there")
        await phone.until(f"{OUTLINE} !== ''")
        assert str(await phone.evaluate(OUTLINE)).startswith("M")
        assert await phone.evaluate(HEARD) == "taken refused"
        await phone.tap("document.getElementById('more')")
        assert await phone.evaluate("spoken.length") == 0, "off until asked for"
        await _keep(phone, "ghost")
        assert [
            round(note) for note in json.loads(await phone.evaluate("JSON.stringify(notes)"))
        ] == [660, 990, 196, 165]
        await phone.tap("document.getElementById('voice')")
        await phone.until("spoken.length")
        assert "This view is already there" in str(await phone.evaluate("spoken.join()"))
        await phone.tap("document.getElementById('more')")
        await phone.tap("document.getElementById('to-terminal')")
        await phone.until('document.getElementById("thumb").hidden')
        await phone.until(
            f"({TERMINAL}).includes('[WITHOUT COVER]') && ({TERMINAL}).includes('auto ON')"
        )
        await _keep(phone, "terminal")
        await phone.tap("document.getElementById('to-thumb')", minimum=18)
        await phone.see("auto ON")
        assert phone.complaints == []


MAPS = """
JSON.stringify([...document.querySelectorAll("#thumb .map")].map((each) => {
  const map = each.querySelector("canvas"), drawn = map.getContext("2d").getImageData(0, 0, map.width, map.height).data;
  const colours = new Set(new Uint32Array(drawn.buffer)).size;
  return {name: each.dataset.name, size: [map.width, map.height], said: map.ariaLabel, colours};
}))
"""  # noqa: E501
TERMINAL = """
Array.from({length: served.terminal.rows}, (_, row) => served.terminal.buffer.active.getLine(row)?.translateToString(true)).join(" ")
"""  # noqa: E501


LINKS = "[...document.querySelectorAll('#files a')].map((each) => each.textContent).join()"
FETCH = """
(() => {
  const request = new XMLHttpRequest();
  request.open("GET", document.querySelectorAll("#files a")[%d].href, false);
  request.send();
  return `${request.status} ${request.getResponseHeader("content-type").split(";")[0]}`;
})()
"""
"""A script that loads a link, as a touch of it does."""
SMALL = (360, 640)
"""The size of the smallest telephones in use, points."""
ON_THEIR_SIDE = [(844, 390), (640, 360)]
"""The sizes of the same telephones on their side, points."""
SIZES = [SIZE, SMALL, *ON_THEIR_SIDE]
KEYBOARDS = {SIZE: 290, SMALL: 290, **dict.fromkeys(ON_THEIR_SIDE, 190)}
"""The heights of a keyboard with its line of suggestions, by the size of the page, points."""
LIVE = "document.querySelector('#picture .frame')"
VIEWS = "[...document.querySelectorAll('.list button')]"
"""The list of the views in the results."""
LETTERS = "parseFloat(getComputedStyle(document.querySelector('main pre')).fontSize)"
"""The size of the letters of a table, points."""
COLOUR = "getComputedStyle(document.querySelector('%s')).color"
CHOICE = "[...document.querySelectorAll('.choice > button')].at(-1)"
OPTIONS = f"{CHOICE}.parentElement.querySelector('ul')"
"""The last list of the set-up, the shape of the cover."""
CALL = "document.querySelector('#dock [data-name={}]')"
BUTTON = "document.querySelector('nav [data-key=\"{}\"]')"
NAMES_A_KEY = r"/\b(esc|F1|enter|space|tab|q)\b|\^[a-z]\b|[Pp]ress /"


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
def test_what_must_be_done_now_is_always_on_the_screen(
    size: tuple[int, int], brief: Path, tmp_path: Path
) -> None:
    served = Served(tmp_path / "session")
    tried(_both_phases(served.address, size, brief, tmp_path), served)
    assert len(list((tmp_path / "session" / "frames").glob("*.png"))) == 2


async def _both_phases(address: str, size: tuple[int, int], source: Path, folder: Path) -> None:
    with_keyboard = (size[0], size[1] - KEYBOARDS[size])
    async with telephone(address, folder / "profile", size) as phone:
        await phone.see("Where pictures come from")
        await phone.until(VISIBLE % CALL.format("hint"))
        await phone.tap(CHOICE)
        await phone.until(f"!{OPTIONS}.hidden")
        await asyncio.sleep(1.0)  # whatever moves the page after that has moved it
        for end in ("first", "last"):
            await phone.until(VISIBLE % f"{OPTIONS}.{end}ElementChild")
        await _keep(phone, "list", size)
        await phone.fill("source", f"folder:{source}")
        await phone.until(f"{OPTIONS}.hidden")  # somebody has gone on
        await phone.choose("shape", "cone")
        for name, text in (("columns", "9"), ("rows", "9"), ("square_mm", "0.02")):
            await phone.fill(name, text)
        modes = "['columns', 'square_mm', 'source'].map((name) => document.getElementById(`field-${name}`).inputMode).join()"  # noqa: E501
        assert await phone.evaluate(modes) == "numeric,decimal,text"
        await phone.resize(with_keyboard)
        await phone.see("if metres were meant")
        for script in (CALL.format("problem"), BUTTON.format("ctrl+s"), "document.activeElement"):
            await phone.until(VISIBLE % script)
        await _keep(phone, "keyboard-wrong", size)
        await phone.let_go()
        await phone.fill("square_mm", "20")  # the touch selects what is there
        for name, text in zip(COVER, CONE, strict=True):
            await phone.fill(name, text)
            await phone.until(VISIBLE % "document.activeElement")
        await phone.until(VISIBLE % BUTTON.format("ctrl+s"))
        await phone.press("ctrl+s")  # with the keyboard still open
        await phone.resize(size)
        await phone.see("Without cover")
        await phone.see("or Cover on, then put the cover on.")
        for script in (CALL.format("verdict"), BUTTON.format("n"), LIVE):
            await phone.until(VISIBLE % script)
        await _keep(phone, "phase-bare", size)
        await phone.press("n")
        await phone.see("NOW PUT THE COVER ON")
        await phone.until(VISIBLE % CALL.format("now"))
        await asyncio.sleep(1.0)  # whatever moves the page after that has moved it
        await _keep(phone, "phase-cover-on", size)
        for script in (CALL.format("now"), BUTTON.format("ctrl+s")):
            await phone.until(VISIBLE % script)
        await phone.until("document.querySelector('main').scrollTop === 0")
        await phone.tap("document.getElementById('field-source')")
        await phone.resize(with_keyboard)
        for script in (
            CALL.format("now"),
            BUTTON.format("ctrl+s"),
            "document.getElementById('field-source')",
        ):
            await phone.until(VISIBLE % script)
        await _keep(phone, "keyboard-cover-on", size)
        await phone.press("ctrl+s")
        await phone.resize(size)
        await phone.see("Through cover")
        await phone.see("no more pictures")
        for script in (CALL.format("verdict"), BUTTON.format("f"), LIVE):
            await phone.until(VISIBLE % script)
        await _keep(phone, "phase-covered", size)
        assert phone.complaints == []


@pytest.mark.slow
@pytest.mark.parametrize("size", [SIZE, (360, 640)])
def test_a_rig_by_touch(tmp_path: Path, size: tuple[int, int]) -> None:
    """Both pictures stand above one another, each with its name and its marks, and the page says
    the next command.
    """
    sources = []
    for name in ("left", "right"):
        times = [k * 0.25 for k in range(2 * len(SHARED))]
        record(tmp_path / name, name, times, resting(SHARED))
        sources += ["--source", f"{name}=folder:{tmp_path / name}?speed=max"]
    served = Served(tmp_path / "rig", *sources, *BOARD_FLAGS)
    tried(_rig(served.address, tmp_path, size), served)
    for name in ("left", "right"):
        assert len(list((tmp_path / "rig" / name / "frames").glob("*.png"))) == len(SHARED)


async def _rig(address: str, folder: Path, size: tuple[int, int]) -> None:
    async with telephone(address, folder / "profile", size) as phone:
        await phone.see("The sources have no more pictures. Touch Reopen to try again")
        await phone.see(f"Then: calib rig fit {folder}/rig")
        await phone.see("left: 4 views right: 4 views")
        for label in ("left", "right", "HOLD IT HERE"):
            await phone.until(
                f"document.querySelector('#picture svg').textContent.includes('{label}')"
            )
        shape = "(({naturalWidth, naturalHeight}) => naturalHeight / naturalWidth)"
        ratio = await phone.evaluate(f"{shape}(document.querySelector('#picture img'))")
        assert isinstance(ratio, float)
        assert ratio == pytest.approx(1.5, rel=0.01)  # two pictures of 4 by 3
        await phone.until(VISIBLE % CALL.format("verdict"))
        await _keep(phone, "rig", size)
        await phone.press("a")
        await phone.tap("document.getElementById('more')")
        await phone.tap("document.getElementById('quit')")
        await phone.until("document.body.classList.contains('-closed')")


async def _keep(phone: Telephone, name: str, size: tuple[int, int] = SIZE) -> None:
    """Check that nothing is cut off at the sides, and that no sentence names a key; keep a picture
    of it if one is wanted.
    """
    await phone.until(f"({OUTSIDE.strip()}) === ''")
    assert not await phone.evaluate(f"{NAMES_A_KEY}.exec({WORDS})?.[0]"), await phone.words()
    if folder := os.environ.get("REFRACAL_PICTURES"):
        await asyncio.sleep(0.5)  # the last change is drawn
        await phone.picture(Path(folder) / f"phone-{name}-{size[0]}.png")

"""The set-up: typed texts count, however fast the next key follows, and each field has its own
help.
"""

import asyncio
import shutil
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from textual.app import App
from textual.widgets import Input, Select, Static

from capture.session_file import read_setup
from capture.tui.mirror import describe_screen
from capture.tui.row import ASSUMED
from tests.capture.tui.driving import CONE, burst, describe, drive, running, see, shown, until
from tests.capture.tui.test_session import FIXTURE
from tests.fuzz.keys import walk


def test_start_waits_for_keys_typed_before_it(brief: Path, tmp_path: Path) -> None:
    session = tmp_path / "session"
    drive(_fast(session, brief))
    assert read_setup(session / "session.yaml")[2] == read_setup(FIXTURE / "session.yaml")[2]


async def _fast(session: Path, brief: Path) -> None:
    async with running(session, f"folder:{brief / 'bare'}") as pilot:
        await see(pilot, "a new session")
        pilot.app.screen.query_one("#shape", Select).value = "cone"
        await see(pilot, "inner_radius_mm")
        fields = [*("9", "9", "20"), *CONE]
        keys = [piece for text in fields for piece in ("<ctrl+u>", "<ctrl+k>", text, "<enter>")]
        burst(pilot, "<enter>", "<enter>", "<tab>", *keys[:12], "<tab>", *keys[12:-1], "<ctrl+s>")
        await see(pilot, "[WITHOUT COVER]")
        await see(pilot, "no more pictures")


def test_a_start_that_is_refused_leads_to_the_field(tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    bare.mkdir()
    cv2.imwrite(str(bare / "0.png"), np.full((616, 820), 100, np.uint8))
    drive(_refused(tmp_path / "session", f"folder:{bare}"))


async def _refused(session: Path, source: str) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await describe(pilot, source)
        square = next(
            field
            for field in pilot.app.screen.query("#board Input").results(Input)
            if field.name == "square_mm"
        )
        radius = next(
            field
            for field in pilot.app.screen.query("#cover Input").results(Input)
            if field.name == "inner_radius_mm"
        )
        typed = radius.value
        square.value = radius.value = ""
        assert (square.placeholder, radius.placeholder) == ("needed", "needed, or ?")
        await pilot.press("ctrl+s")
        await until(pilot, lambda: pilot.app.screen.focused is square)
        assert square.has_class("wrong")
        assert radius.has_class("wrong"), "every field that is to be filled in has a mark"
        assert str(pilot.app.screen.query_one("#problem", Static).render())
        radius.value = "-5"
        radius.focus()
        await see(pilot, " inner_radius_mm is -5")
        assert "cover.inner_radius_mm" not in shown(pilot)
        radius.value = typed
        square.focus()
        await until(pilot, lambda: not radius.has_class("wrong"))
        await pilot.press("2", "0", "ctrl+s")
        await see(pilot, "[WITHOUT COVER]")


def test_what_is_needed_and_what_is_assumed_says_so(tmp_path: Path) -> None:
    drive(_assumed(tmp_path / "session"))


async def _assumed(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session. Fill in what is needed, check what is assumed.")
        await see(pilot, "source needed")
        await see(pilot, "cover shape unknown ▼ not chosen")
        await see(pilot, "thickness_mm unknown assumed")
        form = pilot.app.screen
        form.query_one("#shape", Select).value = "cone"
        await see(pilot, "cover shape cone ▼")
        assert "not chosen" not in shown(pilot)
        await see(pilot, "thickness_mm needed, or ?")
        await see(pilot, "tilt_deg 0, 0 assumed")
        await see(pilot, "refractive_index 1.5 assumed")
        labels = {str(block.get("label")) for block in _page_blocks(pilot.app)}
        assert {"tilt (degrees) (assumed)", "thickness (mm)", "axis offset x, z (mm)"} <= labels
        assert "outside index: 1 in air, 1.333 in water (assumed)" in labels
        next(f for f in form.query(Input) if f.name == "refractive_index").value = "1.49"
        form.query_one("#shape", Select).value = "dome"
        await see(pilot, "cover shape dome ▼")
        await see(pilot, "refractive_index 1.49 outside_index 1 assumed")
        assert "refractive index" in {str(block.get("label")) for block in _page_blocks(pilot.app)}


def test_what_a_session_says_is_not_assumed(tmp_path: Path) -> None:
    shutil.copytree(FIXTURE, tmp_path / "session")
    drive(_stated(tmp_path / "session"))


async def _stated(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "refractive_index 1.5")
        assert "assumed" not in shown(pilot)


def _page_blocks(app: App[None]) -> list[dict[str, object]]:
    """Return the blocks of the screen as a phone's page has them."""
    blocks = describe_screen(app)["blocks"]
    assert isinstance(blocks, list)
    assert ASSUMED not in [block.get("text") for block in blocks]
    return blocks


def test_the_hint_is_that_of_the_field_however_fast_it_is_reached(tmp_path: Path) -> None:
    drive(_hinted(tmp_path / "session"))


async def _hinted(session: Path) -> None:
    async with running(session, "folder:nowhere") as pilot:
        await see(pilot, "a new session")
        burst(pilot, *["<tab>"] * 3, "10", "<tab>", "10", "<tab>", "20", "<tab>")
        await until(pilot, lambda: pilot.app.focused is pilot.app.screen.query_one("#shape"))
        await see(pilot, "Choose the shape of the cover. none: there is none")
        await see(pilot, "tab goes on.")


def test_letters_do_not_overtake_the_keys_that_edit(tmp_path: Path) -> None:
    drive(_edited(tmp_path / "session"))


async def _edited(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        burst(
            pilot,
            "wrong",
            "<ctrl+u>",
            "folder:b",
            "<backspace>",
            "a",
            "<home>",
            "<delete>",
            "F",
            "<enter>",
            "like",
        )
        await see(pilot, "like (optional) like")
        await see(pilot, "source Folder:a")


def test_the_help_leaves_everything_as_it_was(tmp_path: Path) -> None:
    drive(_helped(tmp_path / "session"))


async def _helped(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        burst(pilot, "folder:a", "<enter>", "<enter>")
        await see(pilot, "source folder:a")
        field = pilot.app.focused
        await pilot.press("f1")
        await see(pilot, "A camera behind a cover")
        await pilot.press("escape")
        await see(pilot, "source folder:a")
        assert pilot.app.focused is field


def test_nothing_of_one_field_stays_under_another(tmp_path: Path) -> None:
    drive(_fields(tmp_path / "session"))


async def _fields(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await pilot.press("tab", "tab", "tab", "tab", "tab", *"0.02")
        await see(pilot, "if metres were meant")
        await pilot.press("tab")
        await see(pilot, "Choose the shape of the cover")
        assert "if metres were meant" not in " ".join(shown(pilot).split())
        await pilot.press("enter")  # its choices
        await see(pilot, "cylinder")
        assert "Choose the shape of the cover" in shown(pilot)
        await pilot.press("escape", "shift+tab")
        await see(pilot, "if metres were meant")


@pytest.mark.slow
def test_random_keys(tmp_path: Path) -> None:
    """The same 60 steps every time; `python -m tests.fuzz.keys` takes 10,000."""
    assert asyncio.run(walk(tmp_path / "session", 60, 3)) >= 1


def test_a_key_writes_unknown_into_a_field_of_the_cover_alone(tmp_path: Path) -> None:
    drive(_unknown(tmp_path / "session"))


async def _unknown(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        pilot.app.screen.query_one("#shape", Select).value = "cone"
        await see(pilot, "axis_offset_mm")
        fields = {field.name: field for field in pilot.app.screen.query(Input)}
        fields["axis_offset_mm"].focus()
        await pilot.press("home", *"0, ", "question_mark")
        await until(pilot, lambda: fields["axis_offset_mm"].value == "0, unknown")
        await see(pilot, "? if you do not know")
        fields["columns"].focus()
        await pilot.press("question_mark")
        await until(pilot, lambda: "?" in fields["columns"].value)


def test_numbers_survive_a_change_of_the_shape(tmp_path: Path) -> None:
    """A cover of unknown shape begins with unknown numbers."""
    drive(_reshaped(tmp_path / "session"))


async def _reshaped(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        shape = pilot.app.screen.query_one("#shape", Select)

        def texts() -> dict[str | None, str]:
            return {field.name: field.value for field in pilot.app.screen.query(Input)}

        assert (shape.value, texts().get("thickness_mm")) == ("unknown", "unknown")
        shape.value = "cone"
        await until(pilot, lambda: "inner_radius_mm" in texts())
        fields = {field.name: field for field in pilot.app.screen.query(Input)}
        fields["thickness_mm"].value = "3"
        fields["inner_radius_mm"].value = "40+-5"
        for name, has_key in (("flat", "distance_mm"), ("cone", "tilt_deg"), ("dome", "centre_mm")):
            shape.value = name
            await until(pilot, partial(lambda key: key in texts(), has_key))
        assert texts()["thickness_mm"] == "3"
        assert texts()["inner_radius_mm"] == "40+-5"
        assert texts()["refractive_index"] == "1.5"
        shape.value = "unknown"
        await until(pilot, lambda: "centre_mm" not in texts())
        assert texts()["thickness_mm"] == "3"

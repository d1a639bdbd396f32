"""The set-up: what is typed counts, however fast the next key follows, and pictures of the other kind are refused."""

import asyncio
import shutil
from pathlib import Path

import pytest
from textual.events import Key
from textual.pilot import Pilot
from textual.widgets import Input, Select

from capture.session_file import read_setup
from tests.capture.tui.driving import CONE, describe, drive, running, see, write
from tests.capture.tui.test_session import FIXTURE
from tests.fuzz.keys import walk


def burst(pilot: Pilot[None], *texts: str) -> None:
    """As over a slow connection: fields and keys arrive at once, before any is looked at. A text of one word in < > is a key."""
    for text in texts:
        if text.startswith("<"):
            pilot.app.post_message(Key(text.strip("<>"), None))
        else:
            for letter in text:
                pilot.app.post_message(Key(letter, letter))


def test_start_waits_for_what_was_typed_before_it(tmp_path: Path) -> None:
    session = tmp_path / "session"
    drive(_fast(session))
    assert read_setup(session / "session.yaml")[2] == read_setup(FIXTURE / "session.yaml")[2]


async def _fast(session: Path) -> None:
    async with running(session, f"folder:{FIXTURE / 'bare'}") as pilot:
        await see(pilot, "a new session")
        fields = [*("9", "9", "20"), *CONE]
        keys = [part for text in fields for part in ("<ctrl+u>", "<ctrl+k>", text, "<enter>")]
        burst(pilot, "<enter>", "<enter>", "<tab>", *keys[:12], "<tab>", *keys[12:-1], "<ctrl+s>")
        await see(pilot, "[WITHOUT COVER]")
        await see(pilot, "no more pictures")


def test_letters_do_not_overtake_the_keys_that_edit(tmp_path: Path) -> None:
    drive(_edited(tmp_path / "session"))


async def _edited(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        burst(pilot, "wrong", "<ctrl+u>", "folder:b", "<backspace>", "a", "<home>", "<delete>", "F", "<enter>", "like")
        await see(pilot, "like (optional) like")
        await see(pilot, "source Folder:a")


@pytest.mark.parametrize("like", [FIXTURE, FIXTURE / "session.yaml"], ids=["folder", "file"])
def test_start_takes_over_another_session_that_was_just_named(like: Path, tmp_path: Path) -> None:
    session = tmp_path / "session"
    drive(_like(session, like))
    assert read_setup(session / "session.yaml")[2] == read_setup(FIXTURE / "session.yaml")[2]


async def _like(session: Path, like: Path) -> None:
    async with running(session, f"folder:{FIXTURE / 'bare'}") as pilot:
        await see(pilot, "a new session")
        burst(pilot, "<enter>", str(like), "<ctrl+s>")
        await see(pilot, "no more pictures")


def test_what_is_corrected_stays_although_another_session_is_named(tmp_path: Path) -> None:
    session = tmp_path / "session"
    drive(_corrected(session))
    assert read_setup(session / "session.yaml")[0].square == pytest.approx(0.0201)


async def _corrected(session: Path) -> None:
    async with running(session, f"folder:{FIXTURE / 'bare'}") as pilot:
        await see(pilot, "a new session")
        await pilot.press("enter")
        await write(pilot, str(FIXTURE))
        await see(pilot, "41.95")
        await pilot.press("tab", "enter", "enter")
        await write(pilot, "20.1")
        await pilot.press("ctrl+s")
        await see(pilot, "no more pictures")


def test_covered_pictures_are_refused_where_bare_ones_are_wanted(tmp_path: Path) -> None:
    drive(_covered_for_bare(tmp_path / "session"))
    assert not (tmp_path / "session").exists()


async def _covered_for_bare(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await describe(pilot, f"folder:{FIXTURE}")
        await pilot.press("ctrl+s")
        await see(pilot, "gives a session's pictures through its cover: for those without, write folder:")


def test_bare_pictures_are_refused_where_covered_ones_are_wanted(tmp_path: Path) -> None:
    shutil.copy(FIXTURE / "session.yaml", tmp_path)
    drive(_bare_for_covered(tmp_path))
    assert not (tmp_path / "frames").exists()


async def _bare_for_covered(session: Path) -> None:
    async with running(session, f"folder:{FIXTURE / 'bare'}") as pilot:
        await see(pilot, "continued")
        await pilot.press("shift+tab", "enter", "down", "enter", "ctrl+s")
        await see(pilot, "has pictures without the cover: name those that were taken through it")


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


def test_what_is_recorded_can_be_fitted_without_a_camera(tmp_path: Path) -> None:
    session = tmp_path / "session"
    shutil.copytree(FIXTURE, session)
    drive(_recorded(session))
    assert (session / "calibration" / "calibration.yaml").exists()


async def _recorded(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "continued, 12 views without cover")
        await see(pilot, "^r Fit what there is")
        await pilot.press("ctrl+r")
        await see(pilot, "[RESULTS]")


def test_back_from_a_source_that_fails_everything_stands_as_it_was_typed(tmp_path: Path) -> None:
    drive(_failed(tmp_path / "session"))


async def _failed(session: Path) -> None:
    async with running(session, "folder:/nowhere") as pilot:
        await see(pilot, "a new session")
        pilot.app.screen.query_one("#shape", Select).value = "none"
        pilot.app.screen.query_one("#board Input", Input).value = "17"
        await pilot.pause()
        await pilot.press("ctrl+s")
        await see(pilot, "/nowhere")
        await pilot.press("escape")
        await see(pilot, "a new session")
        assert pilot.app.screen.query_one("#shape", Select).value == "none"
        assert pilot.app.screen.query_one("#board Input", Input).value == "17"
    async with running(session) as pilot:  # and after the program has ended
        await see(pilot, "columns 17")
        assert pilot.app.screen.query_one("#shape", Select).value == "none"
        assert pilot.app.screen.query_one("#source", Input).value == "folder:/nowhere"


def test_random_keys(tmp_path: Path) -> None:
    """The same 60 steps every time; `python -m tests.fuzz.keys` takes 10,000."""
    assert asyncio.run(walk(tmp_path / "session", 60, 3)) >= 1

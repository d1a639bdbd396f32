"""Another session, named in the set-up: the values that are taken over from it, and those that stay
as typed.
"""

from pathlib import Path

import pytest

from capture.session_file import read_setup
from tests.capture.tui.driving import burst, drive, running, see, write
from tests.capture.tui.test_session import FIXTURE


@pytest.mark.parametrize("like", [FIXTURE, FIXTURE / "session.yaml"], ids=["folder", "file"])
def test_start_takes_over_another_session_that_was_just_named(
    like: Path, brief: Path, tmp_path: Path
) -> None:
    session = tmp_path / "session"
    drive(_like(session, like, brief))
    assert read_setup(session / "session.yaml")[2] == read_setup(FIXTURE / "session.yaml")[2]


async def _like(session: Path, like: Path, brief: Path) -> None:
    async with running(session, f"folder:{brief / 'bare'}") as pilot:
        await see(pilot, "a new session")
        burst(pilot, "<enter>", str(like), "<ctrl+s>")
        await see(pilot, "no more pictures")


def test_a_tilde_is_the_home_in_source_and_like(
    brief: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(brief.parent))
    drive(_tilde(tmp_path / "session", brief))


async def _tilde(session: Path, brief: Path) -> None:
    async with running(session, f"folder:~/{brief.name}") as pilot:
        await see(pilot, "a new session")
        burst(pilot, "<enter>", f"~/{brief.name}")
        await see(pilot, "41.95")
        burst(pilot, "<ctrl+s>")
        await see(pilot, "no more pictures")


def test_corrections_stay_when_another_session_is_named(brief: Path, tmp_path: Path) -> None:
    session = tmp_path / "session"
    drive(_corrected(session, brief))
    assert read_setup(session / "session.yaml")[0].square == pytest.approx(0.0201)


async def _corrected(session: Path, brief: Path) -> None:
    async with running(session, f"folder:{brief / 'bare'}") as pilot:
        await see(pilot, "a new session")
        await pilot.press("enter")
        await write(pilot, str(FIXTURE))
        await see(pilot, "41.95")
        await pilot.press("tab", "enter", "enter")
        await write(pilot, "20.1")
        await pilot.press("ctrl+s")
        await see(pilot, "no more pictures")


def test_corrections_are_restored_although_another_session_is_named(
    tmp_path: Path,
) -> None:
    drive(_reopened(tmp_path / "session"))


async def _reopened(session: Path) -> None:
    async with running(session, "folder:there") as pilot:
        await see(pilot, "a new session")
        burst(pilot, "<enter>", str(FIXTURE))
        await see(pilot, "41.95")
        burst(
            pilot,
            "<enter>",
            "<tab>",
            "<enter>",
            "<ctrl+u>",
            "6",
            "<enter>",
            "<ctrl+u>",
            "25",
            "<enter>",
        )
        await see(pilot, "rows 6 square_mm 25")
    async with running(session, "folder:there") as pilot:
        await see(pilot, "41.95")
        await pilot.press("tab", "tab", "shift+tab")  # the field is looked at once more
        await see(pilot, "Another session, its folder")
        await see(pilot, "rows 6 square_mm 25")

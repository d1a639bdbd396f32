"""Sources in the set-up: a session's two halves, pictures of the other kind, and what cannot be
opened.
"""

import shutil
from pathlib import Path

import pytest
from textual.widgets import Input, Select

from capture.source_folder import is_kind_unknown, may_show_cover
from capture.tui.source import SourceField
from tests.capture.tui.driving import (
    describe,
    drive,
    running,
    see,
    shown,
    start_through_cover,
    until,
)
from tests.capture.tui.test_session import FIXTURE


@pytest.mark.slow
def test_a_recorded_session_gives_both_its_halves_by_one_name(brief: Path, tmp_path: Path) -> None:
    session = tmp_path / "session"
    drive(_both_halves(session, brief))
    assert all((session / half).is_dir() for half in ("bare", "frames"))


async def _both_halves(session: Path, brief: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await describe(pilot, f"folder:{brief}?speed=max")
        await pilot.press("ctrl+s")
        await see(pilot, "Press esc to name other pictures, or n, then put the cover on.")
        assert not (session / "frames").exists()
        await pilot.press("n")
        await see(pilot, "pictures through it as well: ^s goes on with those.")
        await pilot.press("ctrl+s")
        await see(pilot, "THROUGH COVER")
        await see(pilot, "A fit needs 3 views and there are 2: take 1 more view.")


def test_bare_pictures_are_refused_where_covered_ones_are_wanted(tmp_path: Path) -> None:
    shutil.copy(FIXTURE / "session.yaml", tmp_path)
    drive(_bare_for_covered(tmp_path))
    assert not (tmp_path / "frames").exists()


async def _bare_for_covered(session: Path) -> None:
    async with running(session, f"folder:{FIXTURE / 'bare'}") as pilot:
        await see(pilot, "continued")
        await until(pilot, lambda: pilot.app.screen.query_one(SourceField)._cameras is not None)
        assert "no camera found" not in shown(pilot), "pictures need none"
        await start_through_cover(pilot)
        await see(pilot, "has pictures without the cover: name those that were taken through it")


def test_a_source_that_cannot_be_opened_is_marked_in_the_form(tmp_path: Path) -> None:
    drive(_failed(tmp_path / "session"))


async def _failed(session: Path) -> None:
    async with running(session, "folder:/nowhere") as pilot:
        await see(pilot, "a new session")
        pilot.app.screen.query_one("#shape", Select).value = "none"
        fields = pilot.app.screen.query("#board Input").results(Input)
        for field, text in zip(fields, ("17", "6", "20"), strict=True):
            field.value = text
        await pilot.pause()
        await pilot.press("ctrl+s")
        await see(pilot, "/nowhere cannot be listed (No such file or directory)")
        await see(pilot, "✗ source")
        assert "[SET-UP]" in shown(pilot)
        await pilot.press("shift+tab", "tab")
        await see(pilot, "/nowhere cannot be listed")
        assert pilot.app.focused is pilot.app.screen.query_one("#source")
        await pilot.press("end", "x")
        await until(pilot, lambda: "✗ source" not in shown(pilot))
        await pilot.press("backspace")
        await see(pilot, "✗ source")
        assert pilot.app.screen.query_one("#shape", Select).value == "none"
        assert pilot.app.screen.query_one("#board Input", Input).value == "17"
    async with running(session) as pilot:  # and after the program has ended
        await see(pilot, "columns 17")
        assert pilot.app.screen.query_one("#shape", Select).value == "none"
        assert pilot.app.screen.query_one("#source", Input).value == "folder:/nowhere"


@pytest.mark.slow
def test_a_covered_folder_for_bare_pictures_is_doubted_once(tmp_path: Path) -> None:
    """The session.yaml describes a cone, and the session has no bare/ to name instead."""
    session = tmp_path / "session"
    drive(_doubted(session))
    assert len(list((session / "bare").glob("*.png"))) == 3


async def _doubted(session: Path) -> None:
    camera = session.parent / "camera"
    (camera / "frames").mkdir(parents=True)
    shutil.copy(FIXTURE / "session.yaml", camera)
    for number in (1, 2, 3):
        shutil.copy(FIXTURE / "frames" / f"000{number}.jpg", camera / "frames")
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await describe(pilot, f"folder:{camera}")
        await see(pilot, "record now through the cover")
        pilot.app.screen.query_one("#phase", Select).value = "bare"
        await pilot.press("ctrl+s")
        await see(
            pilot,
            "says that its pictures have a cover, a cone, where those without the cover are wanted."
            " Set record now to through",
        )
        assert not session.exists()
        await until(pilot, lambda: pilot.app.focused is pilot.app.screen.query_one("#phase"))
        await pilot.press("ctrl+s")
        await see(pilot, "[WITHOUT COVER]")
        await see(pilot, "3 views")


def test_the_pictures_of_the_bare_step_are_refused_for_the_covered_one(tmp_path: Path) -> None:
    session, camera = tmp_path / "session", tmp_path / "camera"
    camera.mkdir()
    shutil.copy(FIXTURE / "bare" / "0001.jpg", camera)
    (session / "bare").mkdir(parents=True)
    shutil.copy(FIXTURE / "session.yaml", session)
    shutil.copy(camera / "0001.jpg", session / "bare")
    drive(_refused_repeat(session, camera))
    assert not (session / "frames").exists()


async def _refused_repeat(session: Path, camera: Path) -> None:
    async with running(session, f"folder:{camera}") as pilot:
        await see(pilot, "1 view without cover")
        pilot.app.screen.query_one("#phase", Select).value = "covered"
        for _ in range(2):  # a second start does not accept it
            await pilot.press("ctrl+s")
            await see(pilot, "has the pictures that were recorded without the cover")
            await until(pilot, lambda: pilot.app.focused is pilot.app.screen.query_one("#source"))
        assert "[SET-UP]" in shown(pilot)


@pytest.mark.slow
def test_recorded_pictures_are_asked_about_once(tmp_path: Path) -> None:
    """Nothing says whether they show the cover, and a fit would tell only at its end. Most show
    it, as those of a sealed dome do, so that the program proposes that.
    """
    camera = tmp_path / "camera"
    camera.mkdir()
    shutil.copy(FIXTURE / "frames" / "0001.jpg", camera)
    drive(_asked_about(tmp_path / "session", camera))


async def _asked_about(session: Path, camera: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await describe(pilot, "v4l2:/dev/video0")
        await see(pilot, "record now without the cover")
        pilot.app.screen.query_one("#source", Input).value = f"folder:{camera}"
        await see(pilot, "record now through the cover")
        await pilot.press("ctrl+s")
        await see(pilot, "Were these pictures taken through the cover? If so, start once more.")
        assert not session.exists()
        await until(pilot, lambda: pilot.app.focused is pilot.app.screen.query_one("#phase"))
        await pilot.press("ctrl+s")
        await see(pilot, "[THROUGH COVER]")


def test_a_choice_of_the_person_is_not_asked_about(brief: Path, tmp_path: Path) -> None:
    drive(_chosen(tmp_path / "session", (brief / "bare").rename(tmp_path / "pictures")))


async def _chosen(session: Path, camera: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await describe(pilot, f"folder:{camera}")
        pilot.app.screen.query_one("#phase", Select).value = "bare"
        await see(pilot, "record now without the cover")
        await pilot.press("ctrl+s")
        await see(pilot, "[WITHOUT COVER]")
        await see(pilot, "esc to name other pictures, or n, then put the cover on.")
        await see(pilot, "These are few for a lens, 10 are enough: better first add other pictures")


@pytest.mark.parametrize(
    ("source", "is_unknown"),
    [
        ("folder:bare", False),
        ("folder:session", False),
        ("folder:session/frames", False),
        ("folder:both", False),
        ("folder:both/frames", False),
        ("folder:pictures", True),
        ("video:film.mp4", True),
        ("v4l2:/dev/video0", False),
    ],
)
def test_a_name_or_a_description_says_whether_pictures_show_the_cover(
    source: str, is_unknown: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("session/frames").mkdir(parents=True)
    Path("session/session.yaml").touch()
    for kind in ("bare", "frames"):
        Path("both", kind).mkdir(parents=True)
    assert is_kind_unknown(source) is is_unknown


@pytest.mark.parametrize(
    ("source", "is_likely"),
    [
        ("folder:cone", True),
        ("folder:cone/frames", True),
        ("folder:lens", False),
        ("folder:both", False),
        ("folder:both/bare", False),
        ("folder:both/frames", True),
        ("folder:pictures", True),
        ("video:film.mp4", True),
        ("v4l2:/dev/video0", False),
    ],
)
def test_the_proposed_phase_fits_the_source(
    source: str, is_likely: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    board = (
        "format: 1\nboard: {columns: 9, rows: 9, square_mm: 20}\ncamera: {width: 8, height: 6}\n"
    )
    for name, cover in (("cone", "unknown"), ("lens", "none")):
        Path(name, "frames").mkdir(parents=True)
        Path(name, "session.yaml").write_text(f"{board}cover: {{shape: {cover}}}\n")
    for kind in ("bare", "frames"):
        Path("both", kind).mkdir(parents=True)
    assert may_show_cover(source) is is_likely


def test_the_next_required_field_has_the_focus_after_the_bare_step(tmp_path: Path) -> None:
    session = tmp_path / "session"
    shutil.copytree(FIXTURE, session)
    drive(_cover_on(session))


async def _cover_on(session: Path) -> None:
    async with running(session, f"folder:{FIXTURE / 'bare'}") as pilot:
        await see(pilot, "continued")
        await pilot.press("shift+tab", "enter", "up", "enter", "ctrl+s")
        await see(pilot, "[WITHOUT COVER]")
        await see(pilot, "From 10 views on you may go")
        await pilot.press("n")
        await see(pilot, "NOW PUT THE COVER ON, and leave the focus alone. Name the source")
        await until(pilot, lambda: pilot.app.focused is pilot.app.screen.query_one("#source"))
        await see(pilot, "Where pictures come from")

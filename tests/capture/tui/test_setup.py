"""The set-up: what is typed counts, however fast the next key follows, and pictures of the other kind are refused."""

import asyncio
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from textual.widgets import Input, Select, Static

from calib.cli import main
from capture.session_file import read_setup
from capture.tui.app import CaptureApp
from capture.tui.fit import FitScreen
from capture.tui.lacking import no_lens
from tests.capture.tui.driving import CONE, burst, describe, drive, running, see, shown, until, write
from tests.capture.tui.test_session import FIXTURE
from tests.fuzz.keys import walk


@pytest.fixture
def brief(tmp_path: Path) -> Path:
    """A recorded session that is soon played: two pictures without its cover, and two through it."""
    folder = tmp_path / "brief"
    for half in ("bare", "frames"):
        (folder / half).mkdir(parents=True)
        for name in ("0001.jpg", "0002.jpg"):
            shutil.copy(FIXTURE / half / name, folder / half)
    shutil.copy(FIXTURE / "session.yaml", folder)
    return folder


def test_start_waits_for_what_was_typed_before_it(brief: Path, tmp_path: Path) -> None:
    session = tmp_path / "session"
    drive(_fast(session, brief))
    assert read_setup(session / "session.yaml")[2] == read_setup(FIXTURE / "session.yaml")[2]


async def _fast(session: Path, brief: Path) -> None:
    async with running(session, f"folder:{brief / 'bare'}") as pilot:
        await see(pilot, "a new session")
        fields = [*("9", "9", "20"), *CONE]
        keys = [part for text in fields for part in ("<ctrl+u>", "<ctrl+k>", text, "<enter>")]
        burst(pilot, "<enter>", "<enter>", "<tab>", *keys[:12], "<tab>", *keys[12:-1], "<ctrl+s>")
        await see(pilot, "[WITHOUT COVER]")
        await see(pilot, "no more pictures")


def test_a_start_that_is_refused_leads_to_the_field(tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    cv2.imwrite(str(empty / "0.png"), np.full((616, 820), 100, np.uint8))
    drive(_refused(tmp_path / "session", f"folder:{empty}"))


async def _refused(session: Path, source: str) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await describe(pilot, source)
        square = next(one for one in pilot.app.screen.query("#board Input").results(Input) if one.name == "square_mm")
        square.value = ""
        await pilot.press("ctrl+s")
        await until(pilot, lambda: pilot.app.screen.focused is square)
        assert str(pilot.app.screen.query_one("#problem", Static).render())
        await pilot.press("2", "0", "ctrl+s")
        await see(pilot, "[WITHOUT COVER]")


def test_letters_do_not_overtake_the_keys_that_edit(tmp_path: Path) -> None:
    drive(_edited(tmp_path / "session"))


async def _edited(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        burst(pilot, "wrong", "<ctrl+u>", "folder:b", "<backspace>", "a", "<home>", "<delete>", "F", "<enter>", "like")
        await see(pilot, "like (optional) like")
        await see(pilot, "source Folder:a")


@pytest.mark.parametrize("like", [FIXTURE, FIXTURE / "session.yaml"], ids=["folder", "file"])
def test_start_takes_over_another_session_that_was_just_named(like: Path, brief: Path, tmp_path: Path) -> None:
    session = tmp_path / "session"
    drive(_like(session, like, brief))
    assert read_setup(session / "session.yaml")[2] == read_setup(FIXTURE / "session.yaml")[2]


async def _like(session: Path, like: Path, brief: Path) -> None:
    async with running(session, f"folder:{brief / 'bare'}") as pilot:
        await see(pilot, "a new session")
        burst(pilot, "<enter>", str(like), "<ctrl+s>")
        await see(pilot, "no more pictures")


def test_a_tilde_is_the_home_in_source_and_like(brief: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(brief.parent))
    drive(_tilde(tmp_path / "session"))


async def _tilde(session: Path) -> None:
    async with running(session, f"folder:~/{brief.name}") as pilot:
        await see(pilot, "a new session")
        burst(pilot, "<enter>", f"~/{brief.name}")
        await see(pilot, "41.95")
        burst(pilot, "<ctrl+s>")
        await see(pilot, "no more pictures")


def test_what_is_corrected_stays_although_another_session_is_named(brief: Path, tmp_path: Path) -> None:
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


def test_what_was_corrected_is_there_again_although_another_session_is_named(tmp_path: Path) -> None:
    drive(_reopened(tmp_path / "session"))


async def _reopened(session: Path) -> None:
    async with running(session, "folder:there") as pilot:
        await see(pilot, "a new session")
        burst(pilot, "<enter>", str(FIXTURE))
        await see(pilot, "41.95")
        burst(pilot, "<enter>", "<tab>", "<enter>", "<ctrl+u>", "6", "<enter>", "<ctrl+u>", "25", "<enter>")
        await see(pilot, "rows 6 square_mm 25")
    async with running(session, "folder:there") as pilot:
        await see(pilot, "41.95")
        await pilot.press("tab", "tab", "shift+tab")  # the field is looked at once more
        await see(pilot, "Another session, its folder")
        await see(pilot, "rows 6 square_mm 25")


def test_a_recorded_session_gives_both_its_halves_by_one_name(brief: Path, tmp_path: Path) -> None:
    session = tmp_path / "session"
    drive(_both_halves(session, brief))
    assert all((session / half).is_dir() for half in ("bare", "frames"))


async def _both_halves(session: Path, brief: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await describe(pilot, f"folder:{brief}?speed=max")
        await pilot.press("ctrl+s")
        await see(pilot, "no more pictures. Press n to go on")
        assert not (session / "frames").exists()
        await pilot.press("n")
        await see(pilot, "pictures through it as well: ^s goes on with those.")
        await pilot.press("ctrl+s")
        await see(pilot, "THROUGH COVER")
        await see(pilot, "no more pictures. Press f to fit")


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


def test_a_source_that_cannot_be_opened_is_marked_in_the_form(tmp_path: Path) -> None:
    drive(_failed(tmp_path / "session"))


async def _failed(session: Path) -> None:
    async with running(session, "folder:/nowhere") as pilot:
        await see(pilot, "a new session")
        pilot.app.screen.query_one("#shape", Select).value = "none"
        pilot.app.screen.query_one("#board Input", Input).value = "17"
        list(pilot.app.screen.query("#board Input").results(Input))[-1].value = "20"
        await pilot.pause()
        await pilot.press("ctrl+s")
        await see(pilot, "/nowhere cannot be listed (No such file or directory)")
        await see(pilot, "✗ source")
        assert "[SET-UP]" in shown(pilot)
        await pilot.press("shift+tab", "tab")
        await see(pilot, "/nowhere cannot be listed")
        assert pilot.app.focused is pilot.app.screen.query_one("#source")
        await pilot.press("end", "x")
        await until(pilot, lambda: "✗ source" not in shown(pilot), 20)
        await pilot.press("backspace")
        await see(pilot, "✗ source")
        assert pilot.app.screen.query_one("#shape", Select).value == "none"
        assert pilot.app.screen.query_one("#board Input", Input).value == "17"
    async with running(session) as pilot:  # and after the program has ended
        await see(pilot, "columns 17")
        assert pilot.app.screen.query_one("#shape", Select).value == "none"
        assert pilot.app.screen.query_one("#source", Input).value == "folder:/nowhere"


def test_a_covered_folder_for_bare_pictures_is_doubted_once(tmp_path: Path) -> None:
    """Its session.yaml says cone, and it has no bare/ to name instead."""
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
        await pilot.press("ctrl+s")
        await see(pilot, "says that its pictures have a cover, a cone, where those without the cover are wanted. Set record now to through")
        assert not session.exists()
        await until(pilot, lambda: pilot.app.focused is pilot.app.screen.query_one("#phase"), 20)
        await pilot.press("ctrl+s")
        await see(pilot, "[WITHOUT COVER]")
        await see(pilot, "3 views")


def test_a_fit_of_nothing_is_refused_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_child(*_: object) -> None:
        raise AssertionError("a process was started for it")

    monkeypatch.setattr(FitScreen, "follow", no_child)
    (tmp_path / "camera").mkdir()
    cv2.imwrite(str(tmp_path / "camera" / "0.png"), np.zeros((616, 820), np.uint8))
    shutil.copy(FIXTURE / "session.yaml", tmp_path)
    drive(_nothing(tmp_path))


async def _nothing(session: Path) -> None:
    async with running(session, f"folder:{session / 'camera'}") as pilot:
        await see(pilot, "continued")
        await pilot.press("shift+tab", "enter", "down", "enter", "ctrl+s")
        await see(pilot, "Start once more to record through the cover first")
        await pilot.press("ctrl+s")
        await see(pilot, "No board of 9x9")
        assert "f Fit" not in shown(pilot)
        shutil.copytree(FIXTURE / "frames", session / "frames", dirs_exist_ok=True)
        await pilot.press("f")
        await see(pilot, no_lens(session).split(str(session))[0].strip())
        await pilot.press("escape", "ctrl+r")
        await see(pilot, "[SET-UP]")
        await see(pilot, no_lens(session).split(str(session))[0].strip())
        for picture in (session / "frames").iterdir():
            picture.unlink()
        (session / "bare").mkdir()
        shutil.copy(FIXTURE / "bare" / "0000.jpg", session / "bare")
        await pilot.press("ctrl+s")
        await see(pilot, "f Fit")
        await pilot.press("f")
        await see(pilot, "There is nothing to fit yet:")


def test_nothing_of_one_field_stays_under_another(tmp_path: Path) -> None:
    drive(_fields(tmp_path / "session"))


async def _fields(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await pilot.press("tab", "tab", "tab", "tab", "tab", *"0.02")
        await see(pilot, "if metres were meant")
        await pilot.press("tab")
        await see(pilot, "The cover in front of the camera")
        assert "if metres were meant" not in " ".join(shown(pilot).split())
        await pilot.press("enter")  # its choices
        await see(pilot, "cylinder")
        assert "The cover in front of the camera" in shown(pilot)
        await pilot.press("escape", "shift+tab")
        await see(pilot, "if metres were meant")


def test_after_the_bare_step_the_field_that_is_asked_for_has_the_focus(tmp_path: Path) -> None:
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
        await until(pilot, lambda: pilot.app.focused is pilot.app.screen.query_one("#source"), 20)
        await see(pilot, "Where pictures come from")


@pytest.mark.slow
def test_a_finished_session_is_opened_without_a_fit(tmp_path: Path) -> None:
    session = tmp_path / "session"
    shutil.copytree(FIXTURE, session)
    assert main(["fit", str(session), "--grid", "5x5"]) == 0
    (session / "calibration" / "report.html").unlink()
    fit = (session / "calibration" / "calibration.yaml").stat().st_mtime_ns
    drive(_finished(session))
    assert (session / "calibration" / "calibration.yaml").stat().st_mtime_ns == fit
    assert (session / "calibration" / "report.html").exists()


async def _finished(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "It is fitted: ^o opens its results.")
        await see(pilot, "^o Results")
        await pilot.press("ctrl+o")
        await see(pilot, "[RESULTS]")
        await see(pilot, "To be trusted where it has corners. The error fell from 0.4")
        await see(pilot, "The maps are sure to")
        await see(pilot, "e Diagnose c Check r Report x Export")
        await pilot.press("r")
        await see(pilot, "The report is ")
        await until(pilot, (session / "calibration" / "report.html").exists, 60)
        assert isinstance(pilot.app, CaptureApp)
        assert pilot.app.farewell[0] == f"The calibration is in {session / 'calibration'}"


def test_ctrl_c_quits_and_what_was_typed_is_kept(tmp_path: Path) -> None:
    drive(_interrupted(tmp_path / "session"))


async def _interrupted(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await pilot.press(*"folder:there", "ctrl+c")
        await until(pilot, lambda: not pilot.app.is_running, 20)
    async with running(session) as pilot:
        await see(pilot, "source folder:there")


def test_of_a_session_that_is_recorded_source_and_what_is_recorded_now_are_there_again(tmp_path: Path, brief: Path) -> None:
    session = tmp_path / "session"
    shutil.copytree(brief, session, ignore=shutil.ignore_patterns("bare"))
    drive(_again(session, f"folder:{brief}"))


async def _again(session: Path, source: str) -> None:
    async with running(session) as pilot:
        await see(pilot, "continued")
        await see(pilot, "record now without the cover")
        await write(pilot, source)
        pilot.app.screen.query_one("#phase", Select).value = False
        await see(pilot, "record now through the cover")
        await pilot.press("escape")
    async with running(session) as pilot:
        await see(pilot, "continued")
        await see(pilot, "record now through the cover")
        assert pilot.app.screen.query_one("#source", Input).value == source
    async with running(session, "folder:other") as pilot:
        await see(pilot, "source folder:other")
        await see(pilot, "record now through the cover")


def test_random_keys(tmp_path: Path) -> None:
    """The same 60 steps every time; `python -m tests.fuzz.keys` takes 10,000."""
    assert asyncio.run(walk(tmp_path / "session", 60, 3)) >= 1

"""Faults leave the app running, with a sentence that says what to do."""

import os
import resource
import shutil
import signal
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from textual.events import Paste
from textual.pilot import Pilot

from capture.disk import locked
from capture.recorder import Recorder
from capture.tui.collect import CollectScreen
from capture.tui.export import ExportScreen
from capture.tui.picture import Picture
from capture.tui.working_page import WorkingPage
from tests.capture.recordings import BOARD, noise, write_recording
from tests.capture.test_rpicam import HEIGHT, PICTURES, SOURCE, STAND_IN, WIDTH
from tests.capture.tui.driving import drive, running, see, shown, until
from tests.capture.tui.test_session import FIXTURE

PLAIN = f"""\
format: 1
board: {{columns: 9, rows: 9, square_mm: 20.0}}
camera: {{width: {WIDTH}, height: {HEIGHT}}}
cover: {{shape: none}}
"""


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """A session that continues through the cover, and can be fitted."""
    folder = tmp_path / "session"
    shutil.copytree(FIXTURE, folder, ignore=shutil.ignore_patterns("truth.npz"))
    return folder


@pytest.fixture
def camera(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a stand-in for rpicam-vid, which is on the PATH."""
    folder = tmp_path / "bin"
    folder.mkdir()
    (folder / "rpicam-vid").write_text(STAND_IN.format(python=sys.executable))
    (folder / "rpicam-vid").chmod(0o755)
    (folder / "grey").write_bytes(b"".join(picture.tobytes() for picture in PICTURES))
    monkeypatch.setenv("PATH", str(folder), prepend=":")
    return folder


@pytest.mark.slow
def test_a_camera_that_is_unplugged_is_tried_again(tmp_path: Path, camera: Path) -> None:
    session = tmp_path / "session"
    session.mkdir()
    (session / "session.yaml").write_text(PLAIN)
    (camera / "script").write_text("0 1 2 fail")
    drive(_unplugged(session, camera))


async def _unplugged(session: Path, camera: Path) -> None:
    async with running(session, SOURCE) as pilot:
        await pilot.press("ctrl+s")
        await see(pilot, "It is tried again every 3 s.")
        assert "no cameras available" in shown(pilot)
        updates = pilot.app.screen.query_one(Picture).updates
        assert updates > 0
        (camera / "script").write_text(" ".join("012" * 20) + " hang")
        await see(pilot, "No board in view")
        assert pilot.app.screen.query_one(Picture).updates > updates


def test_waiting_for_a_slow_camera_is_shown(tmp_path: Path) -> None:
    session = tmp_path / "session"
    session.mkdir()
    (session / "session.yaml").write_text(PLAIN)
    slow = write_recording(tmp_path / "slow", noise(2, WIDTH, HEIGHT), 600.0)
    drive(_slow(session, slow))


async def _slow(session: Path, slow: Path) -> None:
    async with running(session, f"folder:{slow}?speed=1") as pilot:
        await pilot.press("ctrl+s")
        await see(pilot, "s: waiting for the next one.")


@pytest.mark.slow
def test_a_fit_that_is_killed_can_be_repeated(session: Path) -> None:
    drive(_killed_fit(session))


async def _killed_fit(session: Path) -> None:
    async with fitting(session) as (pilot, pid):
        os.kill(pid, signal.SIGKILL)
        await see(
            pilot,
            "was ended from outside (SIGKILL, perhaps for want of memory): start it again. Press f"
            " to fit again",
        )
        await pilot.press("f")
        await see(pilot, "[RESULTS]")


@pytest.mark.slow
def test_a_search_for_effects_that_is_killed_can_be_repeated(session: Path) -> None:
    drive(_killed_search(session))


async def _killed_search(session: Path) -> None:
    async with fitting(session) as (pilot, _):
        await see(pilot, "[RESULTS]")
        await pilot.press("e")
        await see(pilot, "Loading (some seconds)")
        os.kill(_working(pilot), signal.SIGKILL)
        await see(
            pilot,
            "was ended from outside (SIGKILL, perhaps for want of memory): start it again. Press e"
            " to look again",
        )
        await pilot.press("e")
        await see(pilot, "Nothing found")
        await pilot.press("escape")
        await see(pilot, "Views, the worst first")


@pytest.mark.slow
def test_a_fit_is_cancelled(session: Path) -> None:
    drive(_cancelled_fit(session))


async def _cancelled_fit(session: Path) -> None:
    async with fitting(session) as (pilot, pid):
        await pilot.press("escape")
        await see(pilot, "[THROUGH COVER]")
        await until(pilot, lambda: not _runs(pid))
        assert not (session / "calibration").exists() or not list(
            (session / "calibration").iterdir()
        )


@asynccontextmanager
async def fitting(session: Path) -> AsyncIterator[tuple[Pilot[None], int]]:
    """The app in the middle of a fit, and the number of the process that fits."""
    async with running(session, f"folder:{FIXTURE}") as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s")
        await see(pilot, "12 views")
        await pilot.press("f")
        await see(pilot, "Corners in session")
        yield pilot, _working(pilot)


def _working(pilot: Pilot[None]) -> int:
    assert isinstance(pilot.app.screen, WorkingPage)
    assert pilot.app.screen.child
    return pilot.app.screen.child.pid


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_too_few_views_for_a_fit_are_reported(session: Path) -> None:
    for picture in sorted((session / "frames").glob("*.jpg"))[2:]:
        picture.unlink()
    drive(_too_little(session))


async def _too_little(session: Path) -> None:
    async with running(session, f"folder:{session / 'frames'}") as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s")
        await see(pilot, "no more pictures")
        await pilot.press("f")
        await see(pilot, "A fit needs 3 views and there are 2: take 1 more view.")
        assert "[THROUGH COVER]" in shown(pilot)


@pytest.fixture
def full_disk(session: Path) -> Iterator[Path]:
    """A session of three views. No file may grow beyond 20 kB, which for a writer is the same as a
    full disk. No picture fits.
    """
    for picture in sorted((session / "frames").glob("*.jpg"))[3:]:
        picture.unlink()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    yield session
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_is_reported_and_recorded_pictures_remain(full_disk: Path) -> None:
    drive(_full_disk(full_disk))
    assert len(list((full_disk / "frames").glob("*.*g"))) == 3


async def _full_disk(session: Path) -> None:
    async with running(session, f"folder:{FIXTURE}") as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s")
        await see(
            pilot,
            "cannot be written (File too large): choose another place. It is tried again every"
            " 3 s.",
        )
        assert "3 views" in shown(pilot)
        await pilot.press("a")
        await see(pilot, "auto OFF")


def test_a_small_terminal_is_reported_and_the_camera_continues(session: Path) -> None:
    drive(_small_terminal(session))


async def _small_terminal(session: Path) -> None:
    async with running(session, f"folder:{FIXTURE}") as pilot:
        await see(pilot, "continued")
        await pilot.resize_terminal(60, 15)
        await see(pilot, "This terminal has 60 columns and 15 rows. Enlarge it to 80 and 24")
        await pilot.resize_terminal(80, 24)
        await pilot.press("ctrl+s")
        await see(pilot, "12 views")
        await pilot.resize_terminal(79, 24)
        await see(pilot, "This terminal has 79 columns and 24 rows.")
        await pilot.resize_terminal(80, 24)
        await see(pilot, "[THROUGH COVER]")


def test_a_small_terminal_takes_no_key_but_q(tmp_path: Path) -> None:
    drive(_blind(tmp_path / "session"))


async def _blind(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "a new session")
        await pilot.press(*"folder:a")
        await pilot.resize_terminal(60, 20)
        await see(pilot, "Until then no key does anything but q, which quits.")
        await pilot.press("b", "tab", "ctrl+u", "f1", "ctrl+q", "escape")
        pilot.app.post_message(Paste("pasted"))
        await pilot.pause()
        await pilot.resize_terminal(80, 24)
        await see(pilot, "source folder:a")
        assert "folder:ab" not in shown(pilot)
        await pilot.press("end", "b")  # the field is entered again
        await see(pilot, "source folder:ab")
        await pilot.resize_terminal(60, 20)
        await see(pilot, "no key does anything")
        await pilot.press("q")
        await until(pilot, lambda: not pilot.app.is_running)


@pytest.mark.parametrize("key", ["f1", "x"], ids=["help", "export"])
def test_a_small_terminal_is_reported_over_a_dialog_as_well(key: str, session: Path) -> None:
    drive(_small_dialog(session, key))


async def _small_dialog(session: Path, key: str) -> None:
    async with running(session, f"folder:{FIXTURE}") as pilot:
        await see(pilot, "continued")
        if key == "f1":
            await pilot.press(key)
            words = "A camera behind a cover"
        else:
            place = session / "calibration" / "calibration.yaml"
            await pilot.app.push_screen(ExportScreen(session, place, 1.0))
            words = "Maps that undistort pictures"
        await see(pilot, words)
        await pilot.resize_terminal(40, 10)
        await see(pilot, "This terminal has 40 columns and 10 rows.")
        await see(pilot, "no key does anything but q, which quits.")
        assert words not in shown(pilot)
        await pilot.press("escape", "b")
        await pilot.resize_terminal(80, 24)
        await see(pilot, words)
        await pilot.press("escape")
        await see(pilot, "[SET-UP]")
        await pilot.resize_terminal(40, 10)
        await see(pilot, "This terminal has 40 columns and 10 rows.")


def test_a_second_recorder_is_reported(session: Path) -> None:
    with locked(session):
        drive(_two_recorders(session))


async def _two_recorders(session: Path) -> None:
    async with running(session, f"folder:{FIXTURE}") as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s")
        await see(pilot, f"Another recorder (process {os.getpid()}) writes to")
        assert isinstance(pilot.app.screen, CollectScreen)


def test_leaving_releases_the_session(session: Path) -> None:
    drive(_leave(session))
    with Recorder(session, BOARD):  # nobody holds it
        pass


async def _leave(session: Path) -> None:
    async with running(session, f"folder:{FIXTURE}") as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s")
        await see(pilot, "12 views")
        await _set_up_again(pilot)
        await pilot.press("ctrl+s")
        await see(pilot, "12 views")


async def _set_up_again(pilot: Pilot[None]) -> None:
    await pilot.press("escape")
    await see(pilot, "[SET-UP]")

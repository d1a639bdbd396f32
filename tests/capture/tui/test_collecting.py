"""The collecting screen: a source without the board, the choice of the phase, and a source that has
ended.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from textual.pilot import Pilot
from textual.widgets import Input, Select

from capture.frames import Frame
from capture.gate import KNOWN_VIEW, MOTION_BLUR, FrameDecision
from capture.live_detection import LiveDetection
from capture.recording_loop import Step
from capture.session_file import read_setup
from capture.tui import collect, undistortion_page
from capture.tui.camera import Task
from capture.tui.collect import CollectScreen
from capture.tui.fit import FitScreen
from capture.tui.mirror import describe_screen
from capture.tui.page import Line
from capture.tui.panel import Panel
from capture.tui.picture import Picture
from capture.tui.undistortion_page import UndistortionPage
from tests.capture.recordings import noise, write_recording
from tests.capture.tui.driving import (
    burst,
    confirm_cover,
    drive,
    running,
    see,
    sentences_of,
    shown,
    until,
    write,
)
from tests.capture.tui.test_session import FIXTURE


@pytest.fixture
def empty(tmp_path: Path) -> Path:
    """A folder of three pictures without a board."""
    folder = tmp_path / "camera"
    folder.mkdir()
    for number in range(3):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((616, 820), 100, np.uint8))
    return folder


def test_a_source_without_the_board_gets_a_report_of_the_declared_one(
    tmp_path: Path, empty: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(collect, "REASON_S", 0.3)
    drive(_without(tmp_path / "session", empty.rename(tmp_path / "bare")))


async def _without(session: Path, empty: Path) -> None:
    async with running(session, f"folder:{empty}") as pilot:
        await see(pilot, "a new session")
        burst(pilot, "<enter>", str(FIXTURE), "<ctrl+s>")
        await see(
            pilot,
            "No board of 9x9 inner corners in any of the 3 pictures: count the inner corners; esc"
            " corrects the board.",
        )
        assert "Cover on" not in shown(pilot)
        said = sentences_of(pilot)
        await pilot.press("n")
        assert "[WITHOUT COVER]" in shown(pilot)
        missing = "The cover comes on once there are views without it: none is taken yet."
        await until(pilot, lambda: missing in said)
        await see(pilot, "No board of 9x9 inner corners in any")  # what was wrong comes back
        await pilot.press("escape")
        await see(pilot, "count the inner corners; correct the board here, or name another source.")
        assert "[SET-UP]" in shown(pilot)
        assert pilot.app.focused is not None
        assert pilot.app.focused.name == "columns"


def test_another_board_in_the_pictures_is_proposed_as_by_the_fit(tmp_path: Path) -> None:
    """The pictures show 9x9 corners, and 9x8 are declared."""
    drive(_other_board(tmp_path / "session"))


async def _other_board(session: Path) -> None:
    words = "a board of 9x9 inner corners, and none of these shows the declared 9x8: write rows: 9"
    async with running(session, f"folder:{FIXTURE / 'bare'}") as pilot:
        await see(pilot, "a new session")
        burst(pilot, "<enter>", str(FIXTURE))
        await see(pilot, "41.95")
        rows = next(f for f in pilot.app.screen.query(Input) if f.name == "rows")
        rows.value = "8"
        await pilot.press("ctrl+s")
        await see(pilot, f"{words} in the set-up. Press esc to correct it.")
        await pilot.press("escape")
        await see(pilot, f"{words} in the set-up. Then press ^s to record.")
        await until(pilot, lambda: rows.has_focus)
        await write(pilot, "9")
        await pilot.press("ctrl+s")
        await see(pilot, "12 views")


def test_the_chosen_phase_is_kept(tmp_path: Path, empty: Path) -> None:
    drive(_chosen(tmp_path / "session", empty))


async def _chosen(session: Path, empty: Path) -> None:
    """The phase is through the cover although there is no view without it."""
    async with running(session, f"folder:{empty}") as pilot:
        await see(pilot, "a new session")
        burst(pilot, "<enter>", str(FIXTURE))
        await see(pilot, "41.95")
        await see(pilot, "record now through the cover")  # as most pictures that somebody has
        (session / "bare").mkdir(parents=True)  # as a bare step without a view leaves it
        pilot.app.screen.query_one("#phase", Select).value = "bare"
        await see(pilot, "record now without the cover")
        pilot.app.screen.query_one("#phase", Select).value = "covered"
        await see(pilot, "record now through the cover")
        await confirm_cover(pilot)
        await see(pilot, "[THROUGH COVER]")
        await see(pilot, "No board of 9x9")
        await see(pilot, "computed by the fit: the lens")
        await pilot.press("n")
        await see(pilot, "n ends the views without the cover; f fits these.")
        await pilot.press("escape")
        await see(pilot, "[SET-UP]")
        await see(pilot, "record now through the cover")


def test_before_the_first_view_through_the_cover_the_guide_asks_for_no_files(
    tmp_path: Path, empty: Path
) -> None:
    session = tmp_path / "session"
    shutil.copytree(FIXTURE, session, ignore=shutil.ignore_patterns("frames", "frames.csv"))
    drive(_before_the_first(session, empty))


async def _before_the_first(session: Path, empty: Path) -> None:
    async with running(session, f"folder:{empty}") as pilot:
        await see(pilot, "continued, 12 views without cover and 0 views through it")
        await pilot.press("ctrl+s")
        await see(pilot, "No board of 9x9")
        screen = pilot.app.screen
        assert isinstance(screen, CollectScreen)
        await until(pilot, lambda: screen._improved_views == 0 and not screen._improving)
        assert screen._adviser
        assert (
            screen._adviser.remark == "The accuracy of the maps is computed after the first view."
        )


def test_a_key_after_the_end_records_nothing(tmp_path: Path) -> None:
    shutil.copytree(FIXTURE, tmp_path, dirs_exist_ok=True)
    for picture in sorted((tmp_path / "frames").glob("*.jpg"))[2:]:
        picture.unlink()
    drive(_pressed(tmp_path))
    assert len(list((tmp_path / "frames").glob("*.*g"))) == 2


async def _pressed(session: Path) -> None:
    async with running(session, f"folder:{session / 'frames'}") as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s")
        await see(pilot, "pictures. Press o to look through it again, esc to name another source.")
        assert "Not taken" not in shown(pilot), "the session has them all"
        await see(pilot, "A fit needs 3 views and there are 2: take 1 more view.")
        assert "Take now" not in shown(pilot)
        keys = describe_screen(pilot.app)["keys"]
        assert isinstance(keys, list)
        assert "Fit" in [key["label"] for key in keys]
        assert not any(key["main"] for key in keys), "a fit is not what to do next"
        await pilot.press("space", "space")
        await pilot.pause(0.2)
        await see(pilot, "no more pictures. Press o to look through it again")
        updates = pilot.app.screen.query_one(Picture).updates
        await pilot.press("o")
        await until(pilot, lambda: pilot.app.screen.query_one(Picture).updates >= updates + 2)
        await see(pilot, "no more pictures. Press o to look through it again")
        assert "2 views" in shown(pilot)


def test_a_source_that_has_ended_is_not_looked_through_again_unasked(
    tmp_path: Path, empty: Path
) -> None:
    shutil.copytree(FIXTURE, tmp_path / "session")
    drive(_ended(tmp_path / "session", empty))


async def _ended(session: Path, empty: Path) -> None:
    """The help is closed; then a picture is set aside, as in the results."""
    async with running(session, f"folder:{empty}") as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s")
        await see(pilot, "There are no more pictures. Press f to fit")
        screen = pilot.app.screen
        assert isinstance(screen, CollectScreen)
        starts: list[int] = []
        start = screen._start

        def counted_start() -> None:
            starts.append(1)
            start()

        screen._start = counted_start  # type: ignore[method-assign]
        await pilot.press("question_mark")
        await see(pilot, "A camera behind a cover")
        await pilot.press("escape")
        await see(pilot, "There are no more pictures. Press f to fit")
        assert not starts
        next((session / "frames").glob("*.jpg")).unlink()
        await pilot.press("question_mark")
        await see(pilot, "A camera behind a cover")
        await pilot.press("escape")
        await until(pilot, lambda: bool(starts))
        await see(pilot, "11 views")


def test_a_fit_before_there_are_enough_views_is_doubted_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FitScreen, "follow", lambda *_: None)
    session = tmp_path / "session"
    shutil.copytree(FIXTURE, session)
    for picture in sorted((session / "frames").glob("*.jpg"))[3:]:
        picture.unlink()
    drive(_too_few(session, write_recording(tmp_path / "slow", noise(2, 820, 616), 600.0)))


async def _too_few(session: Path, slow: Path) -> None:
    """The case in which pictures still arrive."""
    async with running(session, f"folder:{slow}") as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s")
        await see(pilot, "[THROUGH COVER]")
        await until(pilot, lambda: pilot.app.screen.query_one(Panel).progress is not None)
        await pilot.press("f")
        await see(pilot, "Press f again to fit all the same.")
        assert "[THROUGH COVER]" in shown(pilot)
        await pilot.press("f")
        await see(pilot, "[FIT]")


def test_once_there_are_enough_views_the_fit_is_the_next_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = tmp_path / "session"
    shutil.copytree(FIXTURE, session)
    for picture in sorted((session / "frames").glob("*.jpg"))[3:]:
        picture.unlink()
    slow = write_recording(tmp_path / "slow", noise(2, 820, 616), 600.0)
    drive(_enough(session, slow, monkeypatch))


async def _enough(session: Path, slow: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async with running(session, f"folder:{slow}?speed=1") as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s")
        await until(pilot, lambda: pilot.app.screen.query_one(Panel).progress is not None)
        screen = pilot.app.screen
        assert isinstance(screen, CollectScreen)
        await until(pilot, lambda: screen.recording is not None and screen._judged_pictures > 0)
        assert main_button(pilot) == "Take now"
        monkeypatch.setattr(CollectScreen, "is_enough", lambda *_: True)
        screen.show_hint(None, screen.query_one(Panel).progress)
        await see(pilot, "ENOUGH: press f to fit. There are enough views. More do no harm.")
        assert main_button(pilot) == "Fit"
        assert screen.recording
        frame = Frame(np.zeros((616, 820), np.uint8), 0, 0.0)
        for sentence in (KNOWN_VIEW, MOTION_BLUR, KNOWN_VIEW):
            decision = FrameDecision(False, sentence)
            screen.show_step(
                screen.recording, Step(frame, LiveDetection(None, 820, 616, 0.0), decision, None, 3)
            )
            wanted = sentence if sentence == MOTION_BLUR else "ENOUGH: press f to fit."
            await see(pilot, wanted)
            assert "move the board elsewhere" not in " ".join(shown(pilot).split())
        assert button(pilot, "Auto")["pressed"] is True
        await pilot.press("a")
        assert button(pilot, "Auto")["pressed"] is False
        assert button(pilot, "Fit")["pressed"] is None


def fitted_session(folder: Path) -> Path:
    """Return a copy of the fixture with an empty calibration."""
    shutil.copytree(FIXTURE, folder)
    (folder / "calibration").mkdir()
    (folder / "calibration" / "calibration.yaml").touch()
    return folder


def test_a_page_reaches_the_results_while_pictures_come(tmp_path: Path) -> None:
    slow = write_recording(tmp_path / "slow", noise(2, 820, 616), 600.0)
    drive(_reached(fitted_session(tmp_path / "session"), slow))


async def _reached(session: Path, slow: Path) -> None:
    async with running(session, f"folder:{slow}?speed=1") as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s")
        await see(pilot, "12 views")
        screen = pilot.app.screen
        assert isinstance(screen, CollectScreen)
        assert screen.recording
        await see(pilot, "u Undistort m Dots esc Set-up ? Help q Quit")  # all that 80 columns take
        pilot.app.on_phone = True  # type: ignore[attr-defined]
        assert {"Take now", "Results", "Undistort"} <= {key["label"] for key in buttons(pilot)}
        pilot.app.on_phone = False  # type: ignore[attr-defined]
        await pilot.resize_terminal(100, 30)
        screen.refresh_bindings()
        await see(pilot, "u Undistort ^o Results m Dots esc Set-up ? Help q Quit")


def test_that_maps_are_being_computed_stays_until_they_come(
    tmp_path: Path, empty: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(UndistortionPage, "_listen_to", lambda *_: None)
    monkeypatch.setattr(undistortion_page, "SHORT_MESSAGE_S", 0.2)
    drive(_computed(fitted_session(tmp_path / "session"), empty))


async def _computed(session: Path, empty: Path) -> None:
    async with running(session, f"folder:{empty}") as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s")
        ending = "There are no more pictures. Press ^o for the results, f to fit anew."
        await see(pilot, ending)
        await see(pilot, "u Undistort")
        screen = pilot.app.screen
        assert isinstance(screen, CollectScreen)
        screen._make(0.48)
        screen._message_until = 0.0  # some seconds later
        await pilot.press("question_mark", "escape")
        await see(pilot, "The maps for 0.48 m are being computed.")
        await see(pilot, "u As it is")
        said = sentences_of(pilot)
        await pilot.press("u")
        await until(pilot, lambda: "The picture is shown as it is." in said)
        await see(pilot, "u Undistort")
        await see(pilot, ending)


def main_button(pilot: Pilot[None]) -> str:
    """Return the label of a page's main button, which is in the first row."""
    main = [key for key in buttons(pilot) if key["main"] and key["top"]]
    assert len(main) == 1
    return str(main[0]["label"])


def button(pilot: Pilot[None], label: str) -> dict[str, object]:
    return next(key for key in buttons(pilot) if key["label"] == label)


def buttons(pilot: Pilot[None]) -> list[dict[str, object]]:
    keys = describe_screen(pilot.app)["keys"]
    assert isinstance(keys, list)
    return keys


def test_the_glass_has_a_map_of_its_own_once_that_is_computed(tmp_path: Path, empty: Path) -> None:
    shutil.copytree(FIXTURE / "frames", tmp_path / "session" / "frames")
    shutil.copy(FIXTURE / "session.yaml", tmp_path / "session")
    drive(_glass(tmp_path / "session", empty))


async def _glass(session: Path, empty: Path) -> None:
    async with running(session, f"folder:{empty}") as pilot:
        await see(pilot, "continued")
        await confirm_cover(pilot)
        await see(pilot, "[THROUGH COVER]")
        panel, glass = pilot.app.screen.query_one(Panel), pilot.app.screen.query_one("#glass", Line)
        await until(pilot, lambda: panel.progress is not None)
        assert panel.progress
        await see(pilot, "computed yet.")
        assert str(glass.content).splitlines()[0] == "Glass"
        panel.progress = replace(panel.progress, sigma_px=0.31)
        await see(pilot, "Glass crossed")


@pytest.mark.parametrize(
    ("source", "is_guided"),
    [
        ("folder:photos", False),
        ("video:film.mp4", False),
        ("folder:recorded?speed=1", True),
        ("v4l2:/dev/video0", True),
    ],
)
def test_nobody_is_guided_who_cannot_move_the_board(source: str, is_guided: bool) -> None:
    setup = read_setup(FIXTURE / "session.yaml")
    screen = CollectScreen(Task(Path("session"), source, setup, bare=False))
    assert screen._has_person is is_guided

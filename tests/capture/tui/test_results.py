"""The results of a session that is opened again, and the contents of their screen that last."""

import shutil
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from threading import Event

import pytest
from textual.pilot import Pilot
from textual.widgets import Input, Static

from calib.progress import Progress
from capture.tui.app import CaptureApp
from capture.tui.child import LOADING
from capture.tui.command import CommandResult
from capture.tui.drop import DroppedPicture, drop_picture, restore_picture
from capture.tui.fit import FitScreen
from capture.tui.help import HelpScreen
from capture.tui.mirror import describe_screen
from capture.tui.results import ResultsScreen
from capture.tui.results_text import ResultsText
from tests.capture.tui.driving import drive, running, see, shown, until, write
from tests.capture.tui.test_session import FIXTURE
from tests.capture.tui.test_snapshots import RESULT

BEFORE = {
    **RESULT,
    "stages": [{"name": "pinhole", "title": "camera alone", "rms_px": 3.33, "rmse_cm": 0.2}],
}


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """A session whose first two views were set aside by a program that has ended."""
    (tmp_path / "frames" / "dropped").mkdir(parents=True)
    shutil.copy(FIXTURE / "session.yaml", tmp_path)
    for number, view in enumerate(RESULT["views"]):  # type: ignore[arg-type, var-annotated]
        aside = tmp_path / "frames" / "dropped" if number < 2 else tmp_path / "frames"
        shutil.copy(FIXTURE / "frames" / view["file"], aside)
    return tmp_path


@asynccontextmanager
async def results(session: Path) -> AsyncIterator[Pilot[None]]:
    async with running(session) as pilot:
        pilot.app.push_screen(ResultsScreen(session, RESULT, BEFORE))
        await see(pilot, "x for maps and straight pictures")
        yield pilot


def farewell(pilot: Pilot[None]) -> Sequence[str]:
    assert isinstance(pilot.app, CaptureApp)
    return pilot.app.farewell


def test_views_that_were_set_aside_are_marked_and_can_be_restored(session: Path) -> None:
    drive(_come_back(session))
    assert sorted(path.name for path in (session / "frames" / "dropped").iterdir()) == ["0001.jpg"]
    assert (session / "frames" / "0002.jpg").exists()


async def _come_back(session: Path) -> None:
    async with results(session) as pilot:
        await see(pilot, "2 views were set aside since this fit: f fits without them")
        assert [
            line.split("  ")[0].strip()
            for line in shown(pilot).splitlines()
            if "px dropped" in line
        ] == ["0001.jpg", "0002.jpg"]
        await see(pilot, "worst: 0.50 px off")
        await pilot.press("down", "z")
        await see(pilot, "0002.jpg is back")
        assert "0002.jpg          0.050 px █" in shown(pilot)


def test_outdated_maps_are_marked_after_views_were_set_aside(session: Path) -> None:
    drive(_as_before(session))


async def _as_before(session: Path) -> None:
    async with results(session) as pilot:
        await pilot.press("x")
        await see(pilot, "these maps are still of the fit")


def test_the_export_uses_the_calibration_that_a_check_updated(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(session)
    drive(_renewed(session))


async def _renewed(session: Path) -> None:
    async with results(session) as pilot:
        assert "brought this calibration up to date" not in shown(pilot)
        updated = Path(str(RESULT["calibration"])).parent / "updated"
        updated.mkdir(parents=True)
        for folder in (updated.parent, updated):
            (folder / "calibration.yaml").touch()
        pilot.app.push_screen(HelpScreen())
        await pilot.press("escape")
        await see(
            pilot, "A check has brought this calibration up to date, into updated/: x exports that."
        )
        await pilot.press("x")
        await see(pilot, "These maps are of the calibration as a check")
        assert pilot.app.screen.query_one("#folder", Input).value == str(updated / "export")


def test_a_dropped_view_moves_no_button(session: Path) -> None:
    restore(session)
    drive(_drop(session))


async def _drop(session: Path) -> None:
    async with results(session) as pilot:
        pilot.app.on_phone = True  # type: ignore[attr-defined]
        labels, top, main = buttons(pilot)
        assert (top, main) == (["Export"], ["Export"])
        await pilot.press("d")
        await see(pilot, "is set aside in frames/dropped")
        assert buttons(pilot) == (labels, ["Export"], ["Fit"])


def buttons(pilot: Pilot[None]) -> tuple[list[str], list[str], list[str]]:
    """Return the labels of a phone's buttons, of those in the first row, and of the main one."""
    keys: list[dict[str, str]] = describe_screen(pilot.app)["keys"]  # type: ignore[assignment]
    return (
        [key["label"] for key in keys],
        [key["label"] for key in keys if key["top"]],
        [key["label"] for key in keys if key["main"]],
    )


def restore(session: Path) -> None:
    for path in (session / "frames" / "dropped").iterdir():
        shutil.move(path, session / "frames")


@pytest.mark.parametrize("medium", ["air", "water", ""])
def test_the_export_of_a_calibration_in_air_names_the_way_to_water(
    session: Path, medium: str
) -> None:
    restore(session)
    drive(_to_water(session, medium))


async def _to_water(session: Path, medium: str) -> None:
    async with running(session) as pilot:
        pilot.app.push_screen(ResultsScreen(session, {**RESULT, "medium": medium}))
        await see(pilot, "x for maps and straight pictures")
        await pilot.press("x")
        await see(pilot, "depths in metres")
        assert pilot.app.screen.query_one("#advice", Static).display == (medium == "air")
        assert ("These maps are for air" in shown(pilot)) == (medium == "air")


def test_the_report_and_no_export_is_the_main_button_of_what_must_not_be_used(
    session: Path,
) -> None:
    drive(_forbidden(session))


async def _forbidden(session: Path) -> None:
    sentences = ["Do not use it.", "The board would be 16 mm wide."]
    result = {**RESULT, "verdict": {"word": "do_not_use", "sentences": sentences}}
    restore(session)
    async with running(session) as pilot:
        pilot.app.push_screen(ResultsScreen(session, result))
        await see(pilot, "Press r for the report, which says more.")
        assert buttons(pilot)[1:] == (["Export"], ["Report"]), "each in its place"
        await pilot.press("x")
        await see(pilot, "depths in metres")
        assert any("Do not use it." in line for line in shown(pilot).splitlines()[3:8])


def test_a_picture_that_is_gone_cannot_be_set_aside(session: Path) -> None:
    shutil.rmtree(session / "frames" / "dropped")
    drive(_gone(session))


async def _gone(session: Path) -> None:
    async with results(session) as pilot:
        await see(pilot, "cannot be read any more")
        await pilot.press("d")
        await see(pilot, "0001.jpg is missing")


def test_a_second_picture_of_that_name_is_the_one_that_comes_back(session: Path) -> None:
    aside = session / "frames" / "dropped"
    shutil.copy(aside / "0002.jpg", aside / "0001-1.jpg")
    drive(_second(session))
    assert (session / "frames" / "0001.jpg").read_bytes() == (
        FIXTURE / "frames" / "0002.jpg"
    ).read_bytes()
    assert (aside / "0001.jpg").exists()


async def _second(session: Path) -> None:
    async with results(session) as pilot:
        await pilot.press("z")
        await see(pilot, "0001.jpg is back")


def test_rejected_views_can_be_restored_the_last_one_first(session: Path) -> None:
    views = [view for view in RESULT["views"] if view["file"] not in ("0001.jpg", "0002.jpg")]  # type: ignore[attr-defined]
    frames = session / "frames"
    for file in ("0002.jpg", "0001.jpg"):  # which was set aside last
        restore_picture(DroppedPicture(file, frames / "dropped" / file))
        time.sleep(0.02)
        drop_picture(session, file)
    drive(_earlier(session, {**RESULT, "views": views}))
    assert not list((frames / "dropped").iterdir())
    assert (frames / "0001.jpg").exists()


async def _earlier(session: Path, result: dict[str, object]) -> None:
    async with running(session) as pilot:
        pilot.app.push_screen(ResultsScreen(session, result))
        await see(pilot, "z Undo")
        await pilot.press("d")
        await see(pilot, "0003.jpg is set aside")
        for file in ("0003.jpg", "0001.jpg", "0002.jpg"):
            await pilot.press("z")
            await see(pilot, f"{file} is back.")
        await see(pilot, "Press f to fit with it.")
        assert "z Undo" not in " ".join(shown(pilot).split())


def test_the_verdict_stays_beside_the_report(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "capture.tui.results.calib",
        lambda _: CommandResult(0, "s/calibration/report.html\n", "", ()),
    )
    drive(_report(session))


async def _report(session: Path) -> None:
    async with results(session) as pilot:
        await pilot.press("r")
        await see(pilot, "The report is s/calibration/report.html")
        text = " ".join(shown(pilot).split())
        assert "You can trust this calibration where the board was in the picture. The" in text
        assert "Press r for the report, x for maps and straight pictures, e to find faults." in text


def test_an_existing_report_is_announced_as_rewritten(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started = Event()

    def slow(_: Sequence[str]) -> CommandResult:
        assert started.wait(60)
        return CommandResult(0, "s/calibration/report.html\n", "", ())

    monkeypatch.setattr("capture.tui.results.calib", slow)
    monkeypatch.chdir(session)
    drive(_anew(session, started))


async def _anew(session: Path, started: Event) -> None:
    async with results(session) as pilot:
        await pilot.press("r")
        await see(pilot, "The report is being written, which takes some seconds.")
        started.set()
        await see(pilot, "The report is s/calibration/report.html")
        started.clear()
        report = Path(str(RESULT["calibration"])).parent / "report.html"
        report.parent.mkdir(parents=True)
        report.touch()
        await pilot.press("r")
        await see(pilot, "The report is being written anew, in place of the one that is there")
        started.set()
        await see(pilot, "The report is s/calibration/report.html")


def test_the_results_screen_names_the_exported_files(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = session / "maps"
    monkeypatch.setattr(
        "capture.tui.export.calib",
        lambda _: CommandResult(0, f"{out / 'rays.npz'}\n{out / 'map_1m.npz'}\n", "", ()),
    )
    drive(_back_from_export(session, out))


async def _back_from_export(session: Path, out: Path) -> None:
    async with results(session) as pilot:
        await pilot.press("x")
        await see(pilot, "depths in metres")
        await pilot.press("escape")
        await see(pilot, "The error fell from")
        await pilot.press("x")
        assert pilot.app.screen.query_one("#depths", Input).value == "0.55", (
            "the middle of the views' depths"
        )
        await write(pilot, "50")
        await pilot.press("ctrl+s")
        await see(pilot, "50 m is far from your boards, which were 0.30 to 1.20 m away")
        await pilot.press("ctrl+s")
        await see(pilot, "Wrote rays.npz map_1m.npz")
        await pilot.press("escape")
        await until(pilot, lambda: f"Wrote2filesin{out}." in "".join(shown(pilot).split()))
        assert "The error fell from" not in shown(pilot)


def endless(progress: Progress, _session: Path, _out: Path) -> dict[str, object]:
    """A fit that a person ends."""
    progress.task(LOADING, 1)
    time.sleep(3600)
    return {}


@pytest.fixture
def _endless(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("capture.tui.fit.fit_session", endless)


@pytest.mark.usefixtures("_endless")
def test_esc_in_a_refit_leads_back_to_the_results(session: Path) -> None:
    drive(_refit(session))


async def _refit(session: Path) -> None:
    async with results(session) as pilot:
        assert "3.330" in shown(pilot)
        await pilot.press("f")
        await see(pilot, "The views are being fitted")
        await pilot.press("escape")
        await see(pilot, "[RESULTS]")
        await see(pilot, "f fits without them")
        assert "3.330" in shown(pilot), "the fit that they are compared with"
        assert (
            farewell(pilot)[0]
            == "The last fit was ended before it had a result: the calibration is still the"
            " previous one."
        )


@pytest.mark.usefixtures("_endless")
@pytest.mark.parametrize("key", ["ctrl+c", "q"])
def test_ending_the_program_in_a_refit_names_the_remaining_calibration(
    session: Path, key: str
) -> None:
    drive(_end(session, key))


async def _end(session: Path, key: str) -> None:
    async with results(session) as pilot:
        assert not farewell(pilot)[0].startswith("The last fit")
        await pilot.press("f")
        await see(pilot, "The views are being fitted")
        await pilot.press(key)
    assert farewell(pilot)[0].startswith("The last fit was ended before it had a result")


@pytest.mark.usefixtures("_endless")
def test_a_fit_that_had_written_its_calibration_was_not_cut_short(session: Path) -> None:
    drive(_late(session))


async def _late(session: Path) -> None:
    async with results(session) as pilot:
        await pilot.press("f")
        await see(pilot, "The views are being fitted")
        folder = session / "calibration"
        folder.mkdir(exist_ok=True)
        (folder / "calibration.yaml").write_text("of this fit")
        await pilot.press("q")
    assert not farewell(pilot)[0].startswith("The last fit")


def when_told(progress: Progress, session: Path, _out: Path) -> dict[str, object]:
    """A fit that ends when the session has a file of that name."""
    progress.task(LOADING, 1)
    while not (session / "end").exists():
        time.sleep(0.01)
    return {key: value for key, value in RESULT.items() if key != "event"}


@pytest.mark.slow
def test_a_fit_that_ends_behind_the_help_gives_its_results_when_that_is_closed(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The results replaced the help, and the fit's screen stayed behind them, with nothing
    running.
    """
    monkeypatch.setattr("capture.tui.fit.fit_session", when_told)
    drive(_behind_help(session))


async def _behind_help(session: Path) -> None:
    async with results(session) as pilot:
        await pilot.press("f")
        await see(pilot, "The views are being fitted")
        await see(pilot, "Loading (some seconds)")
        fitting = pilot.app.screen
        assert isinstance(fitting, FitScreen)
        await pilot.press("question_mark")
        await see(pilot, "A camera behind a cover")
        (session / "end").touch()
        await until(pilot, lambda: fitting.child is None)
        assert "A camera behind a cover" in shown(pilot)
        await pilot.press("escape")
        await see(pilot, "[RESULTS]")
        assert fitting not in pilot.app.screen_stack


@pytest.mark.parametrize("of_an_effect", [True, False])
def test_the_results_do_not_repeat_the_numbers_of_a_diagnosis(
    session: Path, of_an_effect: bool
) -> None:
    """Effects continue the diagnosed fit, so its stages are theirs; another fit is compared
    with.
    """
    stages = list(RESULT["stages"])  # type: ignore[call-overload]
    previous_result = {**RESULT, "stages": stages[:-1] if of_an_effect else stages}
    drive(_compare(session, previous_result, of_an_effect))


async def _compare(session: Path, previous_result: dict[str, object], alone: bool) -> None:
    async with running(session) as pilot:
        pilot.app.push_screen(ResultsScreen(session, RESULT, previous_result))
        await see(pilot, "x for maps and straight pictures")
        assert ("on board before" not in shown(pilot)) == alone


def test_effects_that_the_views_do_not_tell_apart_are_noted(session: Path) -> None:
    drive(_note(session))


async def _note(session: Path) -> None:
    async with running(session) as pilot:
        result = {**RESULT, "notes": ("these views do not tell lens from focal.",)}
        pilot.app.push_screen(ResultsScreen(session, result, BEFORE))
        await see(pilot, "Note: these views do not tell lens from focal.")


def test_maps_that_hold_are_used_before_faults_are_looked_for() -> None:
    sentences = ["You can use the maps. Take care with the numbers.", "A reason."]
    doubtful = {"word": "care", "sentences": sentences, "maps_hold": False}
    words = ResultsText({**RESULT, "verdict": doubtful}, None).next_steps(is_faultless=False)
    assert words == "Press e to find faults, r for the report, x for maps and straight pictures."
    held = {**doubtful, "maps_hold": True}
    words = ResultsText({**RESULT, "verdict": held}, None).next_steps(is_faultless=False)
    assert words == "Press x for maps and straight pictures, r for the report, e to find faults."

"""The text on the screen while a process calculates."""

from pathlib import Path

import pytest

from capture.tui.child import Child
from capture.tui.fit import FitScreen
from capture.tui.fitting import fit_session
from capture.tui.mirror import describe_screen
from capture.tui.working_page import REPEATED_ADVICE
from tests.capture.tui.driving import drive, running, see


def test_each_bar_of_the_error_names_its_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FitScreen, "follow", lambda *_: None)
    drive(_steps(tmp_path))


async def _steps(session: Path) -> None:
    async with running(session) as pilot:
        screen = FitScreen(session)
        await pilot.app.push_screen(screen)
        screen.child = Child(fit_session)
        steps = (
            ("Intrinsics", "0.150 px"),
            (
                "First values, cone",
                "best 6 px",
            ),  # starting values that are tried are no error of the fit
            ("Joint fit", "0.090 px"),
            ("Joint fit", "0.075 px"),
        )
        for title, words in steps:
            screen.post_message(
                FitScreen.ProcessReported(
                    screen.child, {"event": "task", "title": title, "total": 12}
                )
            )
            screen.post_message(
                FitScreen.ProcessReported(
                    screen.child, {"event": "step", "done": 1, "words": words}
                )
            )
        await see(pilot, f"Intrinsics {'█' * 24} 0.150 px Joint fit {'█' * 14}{'░' * 10} 0.090 px")
        bars = [
            (block["label"], block["text"])
            for block in describe_screen(pilot.app)["blocks"]  # type: ignore[attr-defined]
            if block["kind"] == "bar"
        ]
        assert bars[4:] == [
            ("Error left, Joint fit", "0.075 px"),
            ("Error left, Intrinsics", "0.150 px"),
        ]
        assert len(bars[:4]) == len(steps), "the task of loading has ended, and is not there"


def test_a_failure_that_repeats_has_other_advice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FitScreen, "follow", lambda *_: None)
    drive(_fail_twice(tmp_path))


async def _fail_twice(session: Path) -> None:
    async with running(session) as pilot:
        screen = FitScreen(session)
        await pilot.app.push_screen(screen)
        for advice in (FitScreen.RETRY_ADVICE, REPEATED_ADVICE):
            screen.child = Child(fit_session)
            failure = {"event": "error", "sentence": "Too few pictures."}
            screen.post_message(FitScreen.ProcessReported(screen.child, failure))
            await see(pilot, f"Too few pictures. {advice}")

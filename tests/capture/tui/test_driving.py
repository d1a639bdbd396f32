"""The tests' own way to wait: it ends when nothing goes on, not after some time."""

import time
from pathlib import Path

import pytest

from tests.capture.tui.driving import drive, is_idle, running, see, until


def test_a_text_that_never_comes_fails_with_the_screen(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=r"nothing goes on(.|\n)*cover shape"):
        drive(_see_nothing(tmp_path / "s"))


async def _see_nothing(session: Path) -> None:
    async with running(session, "folder:nowhere") as pilot:
        await see(pilot, "a sentence that no screen has")


def test_work_that_goes_on_is_waited_for(tmp_path: Path) -> None:
    drive(_wait_for_worker(tmp_path / "s"))


async def _wait_for_worker(session: Path) -> None:
    """The worker outlasts the looks at an idle app, which are 0.02 s apart or more."""
    async with running(session, "folder:nowhere") as pilot:
        endings: list[bool] = []

        def work() -> None:
            time.sleep(1.0)
            endings.append(True)

        pilot.app.run_worker(work, thread=True)
        assert not is_idle(pilot)
        await until(pilot, lambda: bool(endings))


def test_a_timer_that_runs_once_is_waited_for(tmp_path: Path) -> None:
    drive(_wait_for_timer(tmp_path / "s"))


async def _wait_for_timer(session: Path) -> None:
    async with running(session, "folder:nowhere") as pilot:
        rings: list[bool] = []
        pilot.app.set_timer(1.0, lambda: rings.append(True))
        await until(pilot, lambda: bool(rings))

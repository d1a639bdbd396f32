"""The numbers of a calibration on the results screen, and the drawing of the cover."""

from pathlib import Path

import numpy as np
import pytest

from capture.tui.numbers import Numbers
from capture.tui.results import ResultsScreen
from capture.tui.section_drawing import CAMERA, draw_section
from tests.capture.tui.driving import SIZES, drive, running, see, shown
from tests.capture.tui.test_snapshots import RESULT

WINDOW = np.stack([np.full(9, 0.02), np.linspace(-0.02, 0.02, 9)], -1)


def test_the_camera_is_to_the_left_of_a_window() -> None:
    lines = draw_section([WINDOW, WINDOW + np.array([0.006, 0.0])], 20, 9).splitlines()
    assert len(lines) <= 9
    assert max(map(len, lines)) <= 20
    camera = next(line for line in lines if CAMERA in line)
    glass = min(len(line) - len(line.lstrip()) for line in lines if line and line != camera)
    assert camera.index(CAMERA) < glass
    drawn = [line.rstrip()[-1] for line in lines if line.strip()]
    assert all(ord(character) >= 0x2800 for character in drawn)


def test_without_a_cover_nothing_is_drawn() -> None:
    assert draw_section([], 20, 9) == ""
    assert draw_section([np.zeros((0, 2))], 20, 9) == ""


@pytest.mark.parametrize("size", SIZES)
def test_camera_and_cover_are_shown(size: tuple[int, int], tmp_path: Path) -> None:
    drive(_shown(size, tmp_path))


async def _shown(size: tuple[int, int], session: Path) -> None:
    async with running(session, size=size) as pilot:
        pilot.app.push_screen(ResultsScreen(session, RESULT))
        await see(pilot, "x for maps and straight pictures")
        roomy = size == SIZES[1]
        assert ("fx 503.21 ± 0.42 px" in shown(pilot)) == roomy
        assert "Views, the worst first" in shown(pilot)
        if not roomy:
            await pilot.press("n")
            assert "Views, the worst first" not in shown(pilot)
        await see(pilot, "fx 503.21 ± 0.42 px")
        await see(pilot, "inner_radius 49.21 ± 0.31 mm 50.0 ± 2.0 mm")
        await see(pilot, "From the side")
        await pilot.press("n")
        if not roomy:
            await see(pilot, "Views, the worst first")


def test_a_phone_shows_views_and_numbers(tmp_path: Path) -> None:
    drive(_on_phone(tmp_path))


async def _on_phone(session: Path) -> None:
    async with running(session) as pilot:
        screen = ResultsScreen(session, RESULT)
        pilot.app.push_screen(screen)
        await see(pilot, "x for maps and straight pictures")
        assert not screen.query_one(Numbers).display
        setattr(pilot.app, "on_phone", True)  # noqa: B010  # the type of a pilot's app is App
        await pilot.pause()
        assert screen.query_one(Numbers).display
        assert screen.query_one("#top").display

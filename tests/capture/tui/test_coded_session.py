"""The rendered boards with markers on the screens: collected, fitted and diagnosed."""

import shutil
from pathlib import Path

import pytest

from calib.calibration import Calibration
from calib.verdict.judge import judge
from calib.verdict.verdict import Trust
from fixtures.rays import FIXTURES
from tests.capture.tui.driving import drive, running, see, shown

FRAMES = 24


@pytest.mark.slow
@pytest.mark.parametrize("name", ["charuco", "aprilgrid"])
def test_a_board_with_markers_is_guided_to_its_calibration(name: str, tmp_path: Path) -> None:
    session = tmp_path / name
    session.mkdir()
    shutil.copy(FIXTURES / name / "session.yaml", session)
    drive(_from_its_description(session, name))
    calibration = Calibration.load(session / "calibration")
    assert len(calibration.views) == FRAMES
    assert judge(calibration).word is Trust.TRUSTED


async def _from_its_description(session: Path, name: str) -> None:
    async with running(session, f"folder:{FIXTURES / name}", (120, 40)) as pilot:
        await see(pilot, "continued, 0 views")
        await pilot.press("ctrl+s")
        await see(pilot, "[THROUGH COVER]")
        await see(pilot, "There are no more pictures. Press f to fit")
        assert f"{FRAMES} views" in shown(pilot)
        await pilot.press("f")
        await see(pilot, "The error fell from")
        await pilot.press("e")
        await see(pilot, "Nothing found")

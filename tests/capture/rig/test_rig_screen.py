"""The screen of a rig: two live pictures, what is taken, and the next command."""

from pathlib import Path

import pytest

from capture.rig.rig_folder import RigFolder
from capture.rig.rig_setup import RigSetup
from capture.tui.picture import Picture
from capture.tui.rig_app import RigApp
from tests.capture.rig.pair_recordings import BOARD, ONLY_LEFT, SHARED, record, resting
from tests.capture.tui.driving import drive, see, shown, until

PLACES = (*SHARED, ONLY_LEFT)


@pytest.mark.slow
def test_two_pictures_guide_the_board_and_the_end_says_what_is_next(tmp_path: Path) -> None:
    for name, offset in (("left", 0.0), ("right", 0.008)):
        times = [k * 0.125 + offset for k in range(4 * len(PLACES))]
        record(tmp_path / name, name, times, resting(PLACES))
    drive(_recorded(tmp_path))


async def _recorded(folder: Path) -> None:
    texts = tuple(f"{name}=folder:{folder / name}?speed=max" for name in ("left", "right"))
    rig = RigFolder.of(folder / "rig", ("left", "right"))
    app = RigApp(RigSetup(rig, texts, BOARD, {}))
    app.dots = False
    async with app.run_test(size=(100, 30)) as pilot:
        await see(pilot, "The sources have no more pictures. Press o to try again")
        await see(pilot, "4 shared, 1 alone, auto ON")
        await see(pilot, "left: 5 views")
        assert "right: 4 views" in shown(pilot)
        pictures = pilot.app.screen.query(Picture)
        assert all(picture.preview is not None for picture in pictures)
        await see(pilot, "The disparity is likely off by")
        await see(pilot, "Next, for left")
        await until(pilot, lambda: all(picture.marks for picture in pictures))
        await pilot.press("q")
    assert app.farewell == [
        f"4 shared views and 1 of one camera alone are in {rig.path}.",
        f"Next: calib rig fit {rig.path} -o {rig.path}/calibration",
    ]

"""Someone who follows the screen gets from nothing to exported maps."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from textual.widgets import OptionList

from calib.io.frames_table import read_table
from calib.session.session import read_session
from tests.capture.tui.driving import (
    SIZES,
    describe,
    drive,
    running,
    see,
    shown,
    start_through_cover,
    until,
    write,
)

FIXTURE = Path(__file__).parents[3] / "fixtures" / "covered-bare"


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES, ids=["80x24", "120x40"])
def test_from_nothing_to_maps_by_keys(size: tuple[int, int], tmp_path: Path) -> None:
    drive(_whole_session(size, tmp_path / "session"))


async def _whole_session(size: tuple[int, int], session: Path) -> None:
    async with running(session, size=size) as pilot:
        await see(pilot, "Where pictures come from")
        await describe(pilot, f"folder:{FIXTURE / 'bare'}")
        await pilot.press("ctrl+s")
        await see(pilot, "[WITHOUT COVER]")
        await see(pilot, "There are no more pictures. Press n, then put the cover on.")
        assert len(list((session / "bare").glob("*.png"))) == 12
        assert "12 views" in shown(pilot)

        await pilot.press("n")
        await see(pilot, "Name the source of the pictures through it, then ^s.")
        await write(pilot, f"folder:{FIXTURE}")
        await pilot.press("ctrl+s")
        await see(pilot, "[THROUGH COVER]")
        await see(pilot, "There are no more pictures. Press f to fit")
        assert len(read_table(session / "frames.csv")) == 12
        described, declared = read_session(session), read_session(FIXTURE)
        assert (described.board, described.cover) == (declared.board, declared.cover)

        await pilot.press("f")
        await see(pilot, "[RESULTS]")
        await see(pilot, "The error fell from 0.4")
        assert (session / "calibration" / "calibration.yaml").exists()
        views = pilot.app.screen.query_one(OptionList)
        worst = str(views.get_option_at_index(0).prompt).split()[0]
        await pilot.press("d")
        await see(pilot, f"{worst} is set aside")
        assert not (session / "frames" / worst).exists()
        await pilot.press("z")
        await see(pilot, f"{worst} is back")
        await pilot.press("d", "f")
        await see(pilot, "on board before")
        await until(pilot, lambda: "on board before" in shown(pilot))
        assert pilot.app.screen.query_one(OptionList).option_count == 11

        await pilot.press("x")
        await see(pilot, "Maps that undistort pictures")
        await write(pilot, "0.5 1")
        await pilot.press("ctrl+s")
        await see(pilot, "Wrote")
    for name in ("map_0.5m.npz", "map_1m.npz"):
        with np.load(session / "export" / name) as maps:
            assert {array.shape for array in maps.values() if array.ndim == 2} == {(616, 820)}


def test_a_session_is_continued(tmp_path: Path) -> None:
    session = tmp_path / "session"
    (session / "frames").mkdir(parents=True)
    shutil.copy(FIXTURE / "session.yaml", session)
    for name in ("0000.jpg", "0001.jpg", "0002.jpg"):
        shutil.copy(FIXTURE / "frames" / name, session / "frames")
    drive(_continue(session))


async def _continue(session: Path) -> None:
    async with running(session, f"folder:{FIXTURE}") as pilot:
        await see(pilot, "continued, 0 views without cover and 3 views through it")
        assert "41.95" in shown(pilot)
        assert "without the cover, into bare/" in shown(pilot)  # the lens is not known yet
        await start_through_cover(pilot)
        await see(pilot, "[THROUGH COVER]")
        await see(pilot, "12 views")
    assert sorted(path.name for path in (session / "frames").glob("*.*g"))[:4] == [
        "0000.jpg",
        "0001.jpg",
        "0002.jpg",
        "0003.png",
    ]

"""The export screen may be left while the files are written."""

from collections.abc import Sequence
from pathlib import Path
from threading import Event

import pytest

from capture.tui.command import Done
from capture.tui.export import ExportScreen
from tests.capture.tui.driving import drive, running, see, shown


def test_who_leaves_while_it_writes_is_told_when_it_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left = Event()
    asked: list[Sequence[str]] = []

    def slow(arguments: Sequence[str]) -> Done:
        asked.append(arguments)
        assert left.wait(60)
        return Done(0, f"{tmp_path / 'export' / 'map_1m.npz'}\n", "", ())

    monkeypatch.setattr("capture.tui.export.calib", slow)
    drive(_leave(tmp_path, left))
    assert [words[0] for words in asked] == ["export"]


async def _leave(session: Path, left: Event) -> None:
    calibration = session / "calibration"
    calibration.mkdir()
    (calibration / "calibration.yaml").touch()
    async with running(session, notices=True) as pilot:
        pilot.app.push_screen(ExportScreen(session, calibration))
        await see(pilot, "depths in metres")
        await pilot.press("ctrl+s")
        await see(pilot, "Being written")
        await pilot.press("escape")
        await see(pilot, "Where pictures come from")
        assert "Wrote" not in shown(pilot)
        left.set()
        await see(pilot, "Wrote map_1m.npz")
        assert f"Exported {session / 'export' / 'map_1m.npz'}" in pilot.app.farewell  # type: ignore[attr-defined]

"""Paths in the form's fields are completed."""

import asyncio
from pathlib import Path

import pytest

from capture.tui.path_suggester import PathSuggester
from tests.capture.tui.driving import drive, running, see


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("pictures 1", "pictures 2", ".hidden"):
        (tmp_path / name).mkdir()
    (tmp_path / "pictures 0.mp4").write_bytes(b"")
    (tmp_path / "pictures 1" / "0.png").write_bytes(b"")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("fo", "folder:"),
        ("folder:pic", "folder:pictures 1/"),
        ("folder:pictures 2", "folder:pictures 2/"),
        ("folder:~/pictures 2", "folder:~/pictures 2/"),
        ("folder:", "folder:pictures 1/"),
        ("folder:.h", "folder:.hidden/"),
        ("video:pic", "video:pictures 0.mp4"),
        ("video:pictures 0.mp4", None),
        ("folder:nowhere/a", None),
        ("folder:a\0/", None),
        ("folder:~nobody/x", None),
        ("v4", "v4l2:/dev/video7"),
        ("pic", "pictures 0.mp4"),
        ("~/pictures 2", "~/pictures 2/"),
        ("x", None),
        ("pictures 1/", None),  # its pictures are no sources
    ],
)
@pytest.mark.usefixtures("home")
def test_a_source_is_completed(typed: str, completed: str | None) -> None:
    suggester = PathSuggester(kinds=True, cameras=["v4l2:/dev/video7"])
    assert asyncio.run(suggester.get_suggestion(typed)) == completed


def test_a_folder_that_may_not_be_read_suggests_nothing(home: Path) -> None:
    suggester = PathSuggester(kinds=False)
    assert asyncio.run(suggester.get_suggestion(f"{home}/pictures 0.mp4/")) is None
    assert asyncio.run(suggester.get_suggestion(f"{home}/pi")) == f"{home}/pictures 1/"


def test_right_takes_what_is_suggested(home: Path) -> None:
    drive(_completed(home))


async def _completed(home: Path) -> None:
    async with running(home / "session") as pilot:
        await see(pilot, "a new session")
        await pilot.press(*"folder:pictures")
        await see(pilot, "source folder:pictures 1/")
        await pilot.press("right")
        await pilot.press("enter", *"pictures 2")
        await see(pilot, "like (optional) pictures 2/")
        await see(pilot, "source folder:pictures 1/")  # no suggestion now: it is the text

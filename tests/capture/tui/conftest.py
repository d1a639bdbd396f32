"""The fixtures that several files of these tests share."""

import shutil
from pathlib import Path

import pytest

from calib.cli import main
from tests.capture.tui.test_session import FIXTURE


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session with a calibration from eight of its views."""
    folder = tmp_path_factory.mktemp("session") / "s"
    shutil.copytree(FIXTURE, folder)
    for picture in sorted((folder / "frames").glob("*.jpg"))[8:]:
        picture.unlink()
    assert main(["fit", str(folder), "--free", "none"]) == 0
    return folder


@pytest.fixture
def brief(tmp_path: Path) -> Path:
    """A recorded session that is soon played: two pictures without its cover, and two through
    it.
    """
    folder = tmp_path / "brief"
    for half in ("bare", "frames"):
        (folder / half).mkdir(parents=True)
        for name in ("0001.jpg", "0002.jpg"):
            shutil.copy(FIXTURE / half / name, folder / half)
    shutil.copy(FIXTURE / "session.yaml", folder)
    return folder

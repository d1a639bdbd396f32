"""The rendered boards with markers, of which a third reach out of the picture, recorded from their
own frames.
"""

import json
import shutil
from pathlib import Path

import pytest

from calib.io.frames_table import read_table
from calib.session.session import read_session
from fixtures.rays import FIXTURES
from tests.capture.recordings import capture

FRAMES = 24

each_session = pytest.mark.parametrize("name", ["charuco", "aprilgrid"])


def described(folder: Path, name: str) -> Path:
    """Make a new session with the fixture's board, camera and cover, without pictures."""
    folder.mkdir()
    shutil.copy(FIXTURES / name / "session.yaml", folder)
    return folder


@pytest.mark.slow
@each_session
def test_every_view_is_recorded(name: str, tmp_path: Path) -> None:
    """Every picture shows a different pose, sharp and well lit: the gate has no reason to leave one
    out, least of all those that reach out of the picture.
    """
    session = described(tmp_path / name, name)
    done = capture(
        "record", "--source", f"folder:{FIXTURES / name}?speed=max", session, "--json", timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["views"] == FRAMES
    assert len(read_table(session / "frames.csv")) == FRAMES
    assert read_session(session).board == read_session(FIXTURES / name).board

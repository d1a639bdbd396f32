"""Pictures that the tests of commands describe, and a session that the command fitted."""

import io
import json
from contextlib import redirect_stdout
from pathlib import Path

import pytest

from calib.cli import main
from fixtures.synthetic import scene
from tests.importing import recordings
from tests.test_calibration import write_session


@pytest.fixture
def photos(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of eight pictures, seen from the folder around it."""
    monkeypatch.chdir(tmp_path)
    return recordings.write_pictures(Path("my photos"))


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    """A small session fitted by the command, and the JSON that it printed."""
    folder = write_session(tmp_path_factory.mktemp("cli"), scene(8, views=6, noise=0.05))
    with redirect_stdout(io.StringIO()) as printed:
        code = main(
            ["fit", str(folder), "--grid", "5x4", "--steps", "40", "--depth", "1", "0.5", "--json"]
        )
    assert code == 0
    return folder, json.loads(printed.getvalue())

"""Pictures that the tests of commands describe."""

from pathlib import Path

import pytest

from tests.importing import recordings


@pytest.fixture
def photos(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of eight pictures, seen from the folder around it."""
    monkeypatch.chdir(tmp_path)
    return recordings.write_pictures(Path("my photos"))

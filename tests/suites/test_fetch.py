"""The command that fetches suites of other projects."""

import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from tests.suites import __main__ as command
from tests.suites import fetch
from tests.suites.fetch import CALIBMAR, SUITES


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A repository of one file, without a network."""
    path = tmp_path / "repository"
    path.mkdir()
    (path / "numbers.txt").write_text("1 2 3")
    git = ("git", "-C", str(path), "-c", "user.name=a", "-c", "user.email=a@example.org")
    for arguments in (("init", "-q"), ("add", "."), ("commit", "-qm", "numbers")):
        subprocess.run([*git, *arguments], check=True)
    return path


def test_a_repository_is_fetched_once(
    repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fetch, "CACHE", tmp_path / "cache")
    suite = replace(CALIBMAR, repository=repository.as_uri(), packages=())
    interrupted = tmp_path / "cache" / "calibmar.tmp" / "half"
    interrupted.mkdir(parents=True)
    suite.fetch()
    assert (suite.folder / "numbers.txt").read_text() == "1 2 3"
    repository.rename(tmp_path / "elsewhere")
    suite.fetch()


def test_a_suite_that_cannot_be_fetched_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(fetch, "CACHE", tmp_path / "cache")
    suite = replace(CALIBMAR, repository=(tmp_path / "nothing").as_uri())
    monkeypatch.setattr(command, "SUITES", (suite,))
    assert command.main([]) == command.UNAVAILABLE
    assert "calibmar cannot be fetched" in capfd.readouterr().out
    assert not suite.folder.exists()


def test_names_are_checked(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["aquacale"]) == 2
    assert "choose from aquacal, calibmar, colmap, ncore, newton" in capsys.readouterr().err


@pytest.mark.parametrize("suite", SUITES, ids=lambda suite: suite.name)
def test_each_suite_names_tests_that_are_there(suite: fetch.Suite) -> None:
    assert all(Path(name).is_file() for name in suite.tests if name.endswith(".py"))
    assert suite.packages or suite.repository

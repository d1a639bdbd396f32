"""`capture SESSION` is the terminal UI: how it starts, what it refuses, what it does not load."""

import subprocess
import sys
from pathlib import Path

import pytest

from capture.cli import main
from tests.capture.recordings import capture


@pytest.mark.parametrize(
    "module",
    ["capture.tui.app", "capture.tui.collect", "capture.tui.results", "capture.tui.effects"],
)
def test_the_process_that_draws_never_loads_torch(module: str) -> None:
    code = f"import sys, {module}; print('torch' in sys.modules)"
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        == "False\n"
    )


def test_the_child_that_finds_the_lens_loads_no_torch() -> None:
    code = "import sys, capture.tui.lens; print('torch' in sys.modules)"
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        == "False\n"
    )


def test_a_wrong_source_is_refused_before_the_screen_opens(tmp_path: Path) -> None:
    done = capture(tmp_path / "session", "--source", "webcam:0")
    assert done.returncode == 2
    assert done.stderr.startswith("capture: error: --source webcam:0 names no kind of source")


def test_a_damaged_session_is_refused_before_the_screen_opens(tmp_path: Path) -> None:
    (tmp_path / "session.yaml").write_text("format: 1\nbord: {}\n")
    done = capture("--source", "folder:x", tmp_path)
    assert done.returncode == 2
    assert "bord" in done.stderr


def test_a_file_in_the_place_of_the_session_is_refused_before_the_screen_opens(
    tmp_path: Path,
) -> None:
    (tmp_path / "README.md").write_text("not a session")
    done = capture(tmp_path / "README.md")
    assert done.returncode == 2
    assert done.stderr.endswith(
        "README.md is not a folder: name the session's folder, which is made if need be.\n"
    )


def test_the_help_names_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert "`capture SESSION` is short for it" in text
    assert "capture SESSION --serve the same in a browser" in text


@pytest.mark.parametrize("installed", [True, False])
def test_a_missing_extra_is_named(
    installed: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("capture.commands.ui.find_spec", lambda _: installed or None)
    with pytest.raises(SystemExit):
        main(["ui", "--help-all"])
    text = " ".join(capsys.readouterr().out.split())
    assert "in a browser instead of this terminal" in text
    assert ("first install what it names" in text) is not installed

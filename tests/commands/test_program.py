"""The command that is named as the next one runs where the person is, with the environment
activated or not.
"""

import sys
from pathlib import Path

import pytest

from calib.commands.console import Bars
from calib.commands.program import runnable_command
from calib.commands.verdict_lines import print_verdict
from calib.verdict.verdict import Reason, Verdict


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with both programs, of which this is one that was started there by its place; no
    other is found.
    """
    folder = tmp_path / "an env" / "bin"
    folder.mkdir(parents=True)
    for name in ("calib", "capture"):
        (folder / name).write_text("#!/bin/sh\n")
        (folder / name).chmod(0o755)
    monkeypatch.setattr(sys, "argv", [str(folder / "capture"), "session"])
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    return folder


def test_a_program_that_the_shell_does_not_find_is_named_by_its_place(installed: Path) -> None:
    assert runnable_command("calib fit 'my s'") == f"'{installed}/calib' fit 'my s'"
    assert runnable_command("capture s") == f"'{installed}/capture' s"


def test_the_program_s_path_is_printed_as_typed(
    installed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(installed.parent)
    monkeypatch.setattr(sys, "argv", ["bin/calib"])
    assert runnable_command("calib fit s") == "bin/calib fit s"


def test_a_program_that_the_shell_finds_is_named_without_path(
    installed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(installed))
    assert runnable_command("calib fit s") == "calib fit s"


def test_the_path_is_named_if_the_shell_finds_another_program(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    namesake = tmp_path / "other" / "calib"
    namesake.parent.mkdir()
    namesake.write_text("#!/bin/sh\n")
    namesake.chmod(0o755)
    monkeypatch.setenv("PATH", str(namesake.parent))
    assert runnable_command("calib fit s") == f"'{installed}/calib' fit s"


def test_by_python_m_the_program_is_the_interpreters(
    installed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["/somewhere/calib/__main__.py"])
    monkeypatch.setattr(sys, "executable", str(installed / "python"))
    assert runnable_command("calib fit s") == f"'{installed}/calib' fit s"
    (installed / "calib").unlink()
    assert runnable_command("calib fit s") == "calib fit s", "nothing better is known"


def test_every_command_after_a_verdict_names_the_program_so(
    installed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    print_verdict(
        Verdict((Reason("why.", "calib diagnose it"),), ""),
        [],
        ["calib evaluate it", "calib undistort it"],
    )
    *_, following, first, last = capsys.readouterr().out.splitlines()
    quoted = f"'{installed}/calib'"
    assert following == f"Next: {quoted} diagnose it"
    assert first == f"Then: {quoted} evaluate it"
    assert last.strip() == f"{quoted} undistort it"


def test_a_fit_comes_after_what_its_reason_asks_for(capsys: pytest.CaptureFixture[str]) -> None:
    print_verdict(Verdict((Reason("measure it again.", "calib fit it"),), ""), [])
    assert "Next, once that is done: " in capsys.readouterr().out.splitlines()[-1]


def test_a_bar_whose_title_repeats_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    with Bars() as bars:
        for _ in range(2):
            bars.task("Uneven, as declared", 1)(1, "")
    lines = capsys.readouterr().err.splitlines()
    assert [line[:29].strip() for line in lines] == [
        "Uneven, as declared",
        "Uneven, as declared, again",
    ]


def test_an_empty_line_sets_the_verdict_apart(capsys: pytest.CaptureFixture[str]) -> None:
    print_verdict(Verdict((), "calib undistort it"), [Path("it/report.html")])
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["Wrote it/report.html", ""]
    assert lines[2].startswith("You can trust this calibration")

"""The command as a process: its streams, its signals, its imports and its exit codes."""

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import IO

import cv2
import numpy as np
import pytest

from calib.cli import main
from calib.commands.printing import print_error, print_remark


@pytest.mark.slow
@pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="only Linux has a disk that is always full"
)
def test_a_result_that_cannot_be_printed_is_one_sentence(
    fitted: tuple[Path, dict[str, object]], tmp_path: Path
) -> None:
    command = [
        sys.executable,
        "-m",
        "calib",
        "export",
        str(fitted[0] / "calibration"),
        "--format",
        "npz",
        "-o",
        str(tmp_path),
    ]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.endswith(
        "calib: error: the result cannot be printed (No space left on device): send stdout to"
        " another place.\n"
    )


@pytest.mark.parametrize("words", [(), ("--help",), ("--version",), ("pose", "--help")])
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has such a disk")
def test_help_that_cannot_be_printed_is_one_sentence(words: tuple[str, ...]) -> None:
    with Path("/dev/full").open("w") as full:
        done = in_process(words, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 2
    assert done.stderr.startswith("calib: error: the result cannot be printed (No space left")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has such a disk")
def test_remarks_that_cannot_be_printed_change_nothing(tmp_path: Path) -> None:
    board = ("board", "--square-mm", "0.1", "-o", str(tmp_path / "board"))
    with Path("/dev/full").open("w") as full:
        assert in_process(("fit", "no"), stdout=subprocess.PIPE, stderr=full).returncode == 2
        assert in_process(board, stdout=subprocess.PIPE, stderr=full).returncode == 0


def close_all(numbers: Sequence[int]) -> None:
    for number in numbers:
        os.close(number)


@pytest.mark.parametrize("text", ["abc", "-1", "1e9"])
def test_a_build_date_that_is_no_time_gets_a_sentence(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", text)
    assert main(["init", str(tmp_path / "session")]) == 2
    assert f"SOURCE_DATE_EPOCH is {text!r}: unset it" in capsys.readouterr().err
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert main(["init", str(tmp_path / "session")]) == 0


@pytest.mark.parametrize("program", ["calib", "capture"])
def test_ctrl_c_during_the_imports_prints_no_traceback(program: str) -> None:
    code = (
        "import builtins, signal, sys; sys.meta_path.insert(0, builtins);"
        "signal.signal(signal.SIGINT, signal.default_int_handler);"  # background jobs ignore it
        "builtins.find_spec = lambda name, *_: name.endswith('.cli') and"
        " signal.raise_signal(signal.SIGINT) or None;"
        f"from {program}.__main__ import run; sys.exit(run())"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, f"{program}: interrupted.\n")


def test_closed_streams_get_no_file_of_ours(tmp_path: Path) -> None:
    """The next file that is opened would have the number of the closed one."""
    code = (
        "import os, sys; from calib.cli import main; code = main(['init', sys.argv[1]]);"
        "os.write(2, b'of a library'); os._exit(code)"
    )
    for closed in ([2], [0, 1, 2]):
        folder = tmp_path / str(len(closed))
        done = subprocess.run(
            [sys.executable, "-c", code, str(folder)],
            check=False,
            preexec_fn=partial(close_all, closed),
        )
        assert done.returncode == 0
        assert "of a library" not in (folder / "session.yaml").read_text()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_stopped_import_leaves_nothing(tmp_path: Path, number: int) -> None:
    """The pictures are in a folder of another name until all of them are there."""
    (tmp_path / "photos").mkdir()
    for name in ("0", "1"):
        cv2.imwrite(str(tmp_path / "photos" / f"{name}.png"), np.full((48, 64), 99, np.uint8))
    code = (
        "import os, signal, sys, calib.importing.session_draft as draft;"
        f"signal.signal({int(number)}, signal.SIG_DFL);"  # under nohup, a hangup is ignored
        "from calib.cli import main;"
        f"draft._fill = lambda *_: os.kill(os.getpid(), {int(number)});"
        "sys.exit(main(sys.argv[1:]))"
    )
    options = ("--board", "9x6", "--square-mm", "25", "-o", str(tmp_path / "new"))
    words = ("import", "images", str(tmp_path / "photos"), *options)
    done = subprocess.run([sys.executable, "-c", code, *words], check=False)
    assert done.returncode == 128 + number
    assert [path.name for path in tmp_path.iterdir()] == ["photos"]


def test_a_command_in_a_removed_folder_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert main(["fit", str(tmp_path)]) == 2
    assert "The current folder was removed: change to another" in capsys.readouterr().err


def in_process(
    words: tuple[str, ...], encoding: str = "utf-8", **pipes: int | IO[str]
) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "PYTHONIOENCODING": encoding}
    command = [sys.executable, "-m", "calib", *words]
    return subprocess.run(command, text=True, check=False, env=env, **pipes)  # type: ignore[call-overload, no-any-return]


@pytest.mark.slow
def test_a_reader_that_stops_early_is_no_error(
    fitted: tuple[Path, dict[str, object]], tmp_path: Path
) -> None:
    """`| head` takes the table's first lines, and `2>&1 | true` no line; the files are complete."""
    (tmp_path / "points.csv").write_text("x,y\n200,150\n")
    calibration = str(fitted[0] / "calibration")
    measure = ("measure", calibration, str(tmp_path / "points.csv"), "--depth", "1")
    export = ("export", calibration, "--format", "npz", "--depth", "1", "-o", str(tmp_path))
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = in_process(measure, stdout=writer, stderr=subprocess.PIPE)
        assert (done.returncode, done.stderr) == (0, "")
        assert in_process(export, stdout=writer, stderr=writer).returncode == 0
    finally:
        os.close(writer)
    assert (tmp_path / "map_1m.npz").exists()
    done = in_process(measure, "ascii", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert done.returncode == 0
    assert "mm +- sigma" in done.stdout


def test_an_interrupted_command_prints_only_that(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(_: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("calib.session.session.read_session", interrupt)
    assert main(["fit", "fixtures/clean"]) == 130
    assert capsys.readouterr().err == "calib: interrupted.\n"


def test_a_bug_is_one_sentence_and_exit_code_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(_: Path) -> None:
        raise ZeroDivisionError("by design")

    monkeypatch.delenv("REFRACAL_TRACEBACK")
    monkeypatch.setattr("calib.session.session.read_session", broken)
    assert main(["fit", "fixtures/clean"]) == 1
    err = capsys.readouterr().err
    assert "this is a bug in calib (ZeroDivisionError: by design)" in err
    assert "Traceback" not in err


@pytest.mark.parametrize(("module", "code"), [("cv2", 2), ("calib.lost", 1)])
def test_a_python_without_the_packages_says_what_to_do(
    module: str, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(_: Path) -> None:
        raise ModuleNotFoundError(f"No module named {module!r}", name=module)

    monkeypatch.setattr("calib.session.session.read_session", broken)
    assert main(["fit", "fixtures/clean"]) == code
    err = capsys.readouterr().err
    assert ("has no package cv2: activate the environment" in err) == (code == 2)
    assert ("this is a bug" in err) == (code == 1)


def test_help_loads_no_slow_library() -> None:
    env = {**os.environ, "PYTHONPROFILEIMPORTTIME": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "calib", "--help"],
        capture_output=True,
        text=True,
        check=True,
        env=env,
    )
    assert all(command in done.stdout for command in ("fit", "evaluate", "undistort", "export"))
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert not imported & {"torch", "cv2", "numpy", "rich", "scipy", "yaml"}


def test_the_first_word_separates_remarks_from_errors(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def printed() -> list[str]:
        print_remark("the frames are few.")
        print_remark("Take care at 9 m: no board was there.")
        print_error("calib", "x does not exist.")
        captured = capsys.readouterr()
        assert captured.out == "", "stdout is for the result"
        return captured.err.splitlines()

    assert printed() == [
        "Note: the frames are few.",
        "Take care at 9 m: no board was there.",
        "calib: error: x does not exist.",
    ]
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    note, warning, error = printed()
    assert note == "\x1b[33mNote:\x1b[0m the frames are few."
    assert warning == "\x1b[33mTake care\x1b[0m at 9 m: no board was there."
    assert error == "\x1b[1;31mcalib: error:\x1b[0m x does not exist."

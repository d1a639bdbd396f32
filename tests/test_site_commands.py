"""Every command that the README and the site tell people to type: run where it needs nothing but
files, else read by its own parser.

What changes the machine (pip, apt, git) is read by bash, and what it names must be there. `-s -m
slow` says how many are run.
"""

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib import cli
from calib.commands.command_line import _parser
from calib.extras import EXTRAS
from calib.io.output_folder import Content, OutputFolder
from capture import cli as capture_cli
from tests.importing import recordings
from tests.io.bags import raw, write_bag
from tests.site_commands import ROOT, Typed, commands, mentioned

ALL = tuple(dict.fromkeys(commands()))
RUN = [typed for typed in ALL if typed.kind == "run"]
FIXTURE = ROOT / "fixtures" / "bumps"
CAPTURE_COMMANDS = {"record", "sources"}
"""The commands of `capture` besides the screen, which needs no word."""
MADE = {"NEW", "DIR", "STRAIGHT", "FLEET", "out", "out-two"}
"""The folders that a command makes; they do not exist before."""
PAGES_BOARD, WORLDS_BOARD = "--board 9x6 --square-mm 25", "--board 9x9 --square-mm 20"
"""The board of pictures that a reader has, and that of the pictures that stand for them here."""


def test_there_are_commands_of_every_kind() -> None:
    kinds = Counter(typed.kind for typed in ALL)
    assert kinds["run"] >= 30
    assert kinds["run"] > kinds["parsed"]
    assert {typed.page for typed in ALL} > {
        "README.md",
        "docs/index.md",
        "docs/raspberry-pi.md",
        "docs/coming-from.md",
        "docs/diagnose.md",
    }


@pytest.mark.parametrize("typed", ALL, ids=lambda typed: f"{typed.page}: {typed.line}")
def test_each_command_line_is_accepted_by_its_parser(typed: Typed) -> None:
    words = shlex.split(typed.line.partition(" > ")[0])
    if typed.program == "calib" and "--print-completion" not in words:
        _parser("calib", "", cli.COMMANDS, cli.GROUPS).parse_args(words[1:])
    elif typed.program == "capture" and "--print-completion" not in words:
        _parser("capture", "", capture_cli.COMMANDS).parse_args(
            words[1:] if words[1] in CAPTURE_COMMANDS else ["ui", *words[1:]]
        )
    elif typed.kind == "parsed":
        assert find_spec(words[words.index("-m") + 1]), "the module is there"
    else:
        subprocess.run(["bash", "-n", "-c", typed.line], check=True)
    for path in re.findall(
        r"(?<![\w/.])(?:docs/requirements|tests|fixtures|\.ci)/[\w./-]+", typed.line
    ):
        assert (ROOT / path).exists(), path
    for extras in re.findall(r"'\.\[([\w,]+)\]'", typed.line):
        assert set(extras.split(",")) <= {*EXTRAS, "dev", "docs"}


def test_the_tables_of_the_readme_have_whole_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`BOARD` stands for the options of a board."""
    lens = cv2.FileStorage(str(tmp_path / "camera.yml"), cv2.FileStorage_WRITE)
    lens.write("camera_matrix", np.array([[600.0, 0, 410], [0, 600, 308], [0, 0, 1]]))
    lens.write("distortion_coefficients", np.zeros((1, 5)))
    lens.release()
    monkeypatch.chdir(tmp_path)
    readme = [line for page, line in mentioned() if page == "README.md"]
    assert len(readme) > 25
    for line in readme:
        if "..." in line or " " not in line:
            continue
        program, *words = shlex.split(line.replace("BOARD", "--board 9x6 --square-mm 25"))
        if program == "calib":
            _parser("calib", "", cli.COMMANDS, cli.GROUPS).parse_args(words)
        else:
            screen = [] if words[0] in CAPTURE_COMMANDS else ["ui"]
            _parser("capture", "", capture_cli.COMMANDS).parse_args([*screen, *words])


def options_of(parser: argparse.ArgumentParser) -> dict[str, set[str]]:
    """The options of each command, by its name."""
    choices = next(
        action.choices
        for action in parser._actions
        if isinstance(action, argparse._SubParsersAction)
    )
    options = {option for action in parser._actions for option in action.option_strings}
    results = {"": options}
    for name, command in choices.items():
        results[name] = {option for action in command._actions for option in action.option_strings}
        for action in command._actions:
            if isinstance(action, argparse._SubParsersAction):
                results[name] |= {
                    option
                    for inner in action.choices.values()
                    for item in inner._actions
                    for option in item.option_strings
                }
    return results


def test_names_in_sentences_exist() -> None:
    """Commands, their options, and modules."""
    choices = {
        "calib": options_of(_parser("calib", "", cli.COMMANDS, cli.GROUPS)),
        "capture": options_of(_parser("capture", "", capture_cli.COMMANDS)),
    }
    mentioned_options = list(mentioned())
    assert len(mentioned_options) > 100
    for page, line in mentioned_options:
        program, first, *arguments = line.split()
        if program == "python":
            assert find_spec(arguments[0]), (page, line)
            continue
        command = (
            first
            if first in choices[program]
            else ""
            if first.startswith("-")
            else "ui"
            if program == "capture"
            else None
        )
        assert command is not None, (page, line)
        options = {
            word.partition("=")[0] for word in (first, *arguments) if re.match(r"-\w|--\w", word)
        }
        assert options <= choices[program][command] | {"-m"}, (page, line)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all that the commands speak of, by the names that they use."""
    folder = tmp_path_factory.mktemp("world")
    stored = shutil.ignore_patterns(".detections.json", "calibration")
    for name in ("bumps", "two"):
        shutil.copytree(ROOT / "fixtures" / name, folder / "fixtures" / name, ignore=stored)
    for name in ("SESSION", "OTHER", "HOLDOUT", "pi", "sessions/A17", "sessions/A18"):
        session = shutil.copytree(FIXTURE / "holdout", folder / name, ignore=stored)
        description = Content.of_file(session / "session.yaml")
        OutputFolder(session).add({"session.yaml": description})  # as if `capture` had written it
    shutil.copytree(FIXTURE / "holdout" / "frames", folder / "PICTURES", ignore=stored)
    (folder / "fleet.csv").write_text("id,session\nA17,sessions/A17\nA18,sessions/A18\n")
    picture = cv2.imread(str(FIXTURE / "holdout" / "frames" / "0000.jpg"))
    assert picture is not None
    (folder / "folder").mkdir()
    (folder / "pictures").mkdir()
    shutil.copy(FIXTURE / "tags" / "april-050-0300.jpg", folder / "pictures" / "tags.jpg")
    for name in ("picture.jpg", "left.png", "folder/one.png"):
        cv2.imwrite(str(folder / name), picture)
    np.save(folder / "left_depth.npy", np.full(picture.shape[:2], 0.5, np.float32))
    high, wide = picture.shape[:2]
    for name in ("film.mp4", "dive.mp4"):
        film = cv2.VideoWriter(
            str(folder / name), cv2.VideoWriter.fourcc(*"mp4v"), 10, (wide, high)
        )
        for _ in range(3):
            film.write(picture)
        film.release()
    (folder / "points.csv").write_text(
        "name,image,x,y\nleft,picture.jpg,412.4,300.9\nright,picture.jpg,604.0,315.2\n"
    )
    if find_spec("rosbags"):
        bag = write_bag(folder / "dive", "mcap", [raw("bgr8", np.asarray(picture, np.uint8))] * 3)
        bag.rename(folder / "dive.mcap")
    recordings.cameramodel(folder / "camera-0.cameramodel")
    recordings.tar(folder / "calibrationdata.tar.gz")
    recordings.kalibr(folder / "FOLDER")
    programs = folder / ".venv" / "bin"
    programs.mkdir(parents=True)
    for program in ("calib", "capture"):
        (programs / program).write_text(
            f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m {program} "$@"\n'
        )
        (programs / program).chmod(0o755)
    (folder / ".local" / "share" / "bash-completion" / "completions").mkdir(parents=True)
    _bash(folder, "calib fit SESSION -o OUT")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("page", dict.fromkeys(typed.page for typed in RUN))
def test_each_command_line_runs(page: str, world: Path, tmp_path: Path) -> None:
    """A page's commands in their order, each with what the ones before it left."""
    copied_world = shutil.copytree(world, tmp_path / "world", symlinks=True)
    lines = [typed.line for typed in RUN if typed.page == page]
    for line in lines:
        with _without_what_it_makes(copied_world, line):
            _bash(copied_world, line.replace(PAGES_BOARD, WORLDS_BOARD))
    print(f"{page}: {len(lines)} of {sum(typed.page == page for typed in ALL)} commands ran")


@contextmanager
def _without_what_it_makes(folder: Path, line: str) -> Iterator[None]:
    """A new session is made where there is none: the one that others need stands aside
    meanwhile.
    """
    _, _, output = line.partition(" -o ")
    output = output.split(" ")[0]
    if output in MADE:
        shutil.rmtree(folder / output, ignore_errors=True)
    aside = output == "SESSION" and ("board" in line or "import" in line)
    if aside:
        (folder / "SESSION").rename(folder / "aside")
    yield
    if aside:
        shutil.rmtree(folder / "SESSION")
        (folder / "aside").rename(folder / "SESSION")


def _bash(folder: Path, line: str) -> None:
    environment = os.environ | {
        "PATH": f"{folder / '.venv' / 'bin'}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "HOME": str(folder),
        "OMP_NUM_THREADS": "1",
    }
    done = subprocess.run(
        ["bash", "-ec", line],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert done.returncode == 0, f"{line}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"

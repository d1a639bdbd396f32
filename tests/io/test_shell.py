"""Printed commands can be typed, whatever their paths are called."""

import os
import re
import subprocess
from pathlib import Path

import pytest

from calib.io.shell import from_here, shell_line, shell_path

ROOT = Path(__file__).parents[2]
EXCEPTIONS = {"calib/io/shell.py", "calib/fleet/cluster.py"}
"""The place that quotes paths, and values of variables that are no paths."""


@pytest.mark.parametrize(
    ("path", "word"),
    [
        ("s", "s"),
        ("-dash", "./-dash"),
        ("-a b/c", "'./-a b/c'"),
        ("in/-dash", "in/-dash"),
        ("/-dash", "/-dash"),
    ],
)
def test_a_path_that_begins_with_a_dash_is_no_option(path: str, word: str) -> None:
    assert shell_path(Path(path)) == word
    assert shell_line("calib", Path(path), "--depth") == f"calib {word} --depth"


def test_a_path_below_the_current_folder_is_relative_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = tmp_path.resolve()
    monkeypatch.chdir(here)
    assert from_here(here / "cam0" / "frames") == Path("cam0/frames")
    assert from_here(here) == Path()
    assert from_here(here.parent) == here.parent
    assert from_here(Path("../cam0")) == Path("../cam0")


def test_every_printed_path_is_quoted_in_one_place() -> None:
    quoting = re.compile(r"shlex\.(quote\(str\(|quote\(f|join\(map)")
    for package in ("calib", "capture"):
        for file in (ROOT / package).rglob("*.py"):
            name = file.relative_to(ROOT).as_posix()
            if name not in EXCEPTIONS:
                assert not quoting.search(file.read_text(encoding="utf-8")), name


@pytest.mark.parametrize(
    "name", ["new\nline", "it's\t\\", "\udcff\udcfe", "no\u00a0break", "-\n", "plain", "it's"]
)
def test_a_shell_reads_every_name(name: str) -> None:
    word = shell_path(name)
    assert word.isprintable()
    bash = ["bash", "-c", f"printf %s {word}"]
    printed = subprocess.run(bash, capture_output=True, check=True).stdout
    assert printed.removeprefix(b"./") == os.fsencode(name)

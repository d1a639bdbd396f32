"""One version, which every way to run the programs knows."""

import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml

from calib.version import VERSION

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("program", ["calib", "capture"])
def test_a_checkout_that_is_not_installed_gives_its_version(program: str, tmp_path: Path) -> None:
    for package in ("calib", "capture"):
        shutil.copytree(
            ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    command = [
        sys.executable,
        "-S",
        "-m",
        program,
        "--version",
    ]  # -S: nothing that is installed, nor its metadata
    done = subprocess.run(
        command, cwd=tmp_path, env={}, capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == (f"refracal {VERSION}\n", "")


def test_the_version_is_that_of_the_installed_package() -> None:
    assert version("refracal") == VERSION


def test_the_citation_names_the_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == VERSION

"""The extras that messages name are those of pyproject.toml, and no document promises a package
that is on no index.
"""

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from calib.extras import EXTRAS, how_to_install

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
WRITTEN = [
    path
    for folder in ("calib", "capture", "docs", "fixtures", "benchmarks")
    for path in (ROOT / folder).rglob("*")
]


def test_the_extras_are_those_of_the_project() -> None:
    assert {name: list(needed) for name, needed in EXTRAS.items()} == {
        name: needed
        for name, needed in PROJECT["optional-dependencies"].items()
        if name not in ("dev", "docs")
    }


@pytest.mark.parametrize("extra", EXTRAS)
def test_the_command_is_pip_of_this_very_python(extra: str) -> None:
    words = shlex.split(how_to_install(extra))
    assert words == [sys.executable, "-m", "pip", "install", *EXTRAS[extra]]
    output = subprocess.run(
        [*words[:4], "--help"], capture_output=True, text=True, check=True
    ).stdout
    assert "pip install [options] <requirement specifier>" in output


def test_no_message_names_a_package_that_is_on_no_index() -> None:
    texts = [
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        *(path for path in WRITTEN if path.suffix in (".py", ".md", ".txt")),
    ]
    assert len(texts) > 300
    for path in texts:
        assert not re.search(
            r"install\s+'?refracal(\[|'|\s|$)", path.read_text(encoding="utf-8")
        ), path

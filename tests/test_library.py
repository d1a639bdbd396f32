"""The library's face: the names that `calib` offers, and the programs of docs/library.md, run as
they stand there.
"""

import ast
import os
import pkgutil
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import calib
from calib import InputError

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "library.md").read_text(encoding="utf-8")
PROGRAMS = dict(
    re.findall(r"## (.*?)\n\n```python\n(.*?)```\n\nprints\n\n```\n.*?```", PAGE, re.DOTALL)
)
PRINTED = dict(
    re.findall(r"## (.*?)\n\n```python\n.*?```\n\nprints\n\n```\n(.*?)```", PAGE, re.DOTALL)
)
FIT, *OTHERS = PROGRAMS
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
LAST_DIGIT = 1.01
"""Units of the last printed digit by which another processor's number may differ; whole numbers are
the same everywhere.
"""


def test_every_name_is_there_for_type_checkers_and_at_run_time() -> None:
    tree = ast.parse(Path(calib.__file__).read_text(encoding="utf-8"))
    imports = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("calib.")
    ]
    modules = {alias.name: node.module for node in imports for alias in node.names}
    assert modules.pop("VERSION") == "calib.version"
    assert modules == calib._MODULES  # type: ignore[attr-defined]  # hidden from type checkers
    assert sorted([*modules, "__version__"]) == sorted(calib.__all__)
    assert set(calib.__all__) <= set(dir(calib))
    assert all(getattr(calib, name).__module__ == home for name, home in modules.items())


def test_no_name_is_also_a_module() -> None:
    """Importing calib.fit, say, would put the module in the function's place."""
    assert not {module.name for module in pkgutil.iter_modules(calib.__path__)} & set(calib.__all__)


def test_a_misspelt_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'calib' has no attribute 'fits'"):
        getattr(calib, "fits")  # noqa: B009  # type checkers refuse calib.fits


def test_a_folder_may_be_named_by_a_string() -> None:
    with pytest.raises(InputError, match="nowhere does not exist"):
        calib.read_session("nowhere")


def test_the_page_has_seven_programs() -> None:
    assert len(PROGRAMS) == len(re.findall("```python", PAGE)) == 7


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A folder in which the first program has run, and what it printed."""
    folder = tmp_path_factory.mktemp("fit")
    return folder, _run(FIT, folder)


def test_the_first_program_prints_what_the_page_says(fitted: tuple[Path, str]) -> None:
    _compare(fitted[1], PRINTED[FIT])


@pytest.mark.parametrize(
    "title",
    [
        title if "Make an" in title else pytest.param(title, marks=pytest.mark.slow)
        for title in OTHERS
    ],
)
def test_the_other_programs_print_what_the_page_says(
    title: str, fitted: tuple[Path, str], tmp_path: Path
) -> None:
    shutil.copytree(fitted[0] / "out", tmp_path / "out")
    _compare(_run(title, tmp_path), PRINTED[title])


def _run(title: str, folder: Path) -> str:
    """Return the output of a program in a folder that has the fixtures that it names."""
    program = PROGRAMS[title]
    for name in set(re.findall(r"fixtures/(\w+)", program)):
        shutil.copytree(
            ROOT / "fixtures" / name,
            folder / "fixtures" / name,
            ignore=shutil.ignore_patterns(".detections.json"),
        )
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def _compare(printed: str, page: str) -> None:
    """The same words, and the same numbers but for the last digit."""
    assert NUMBER.sub("#", printed) == NUMBER.sub("#", page)
    for number, expected in zip(NUMBER.findall(printed), NUMBER.findall(page), strict=True):
        digits = len(expected.partition(".")[2])
        tolerance = LAST_DIGIT * 10**-digits if digits else 0
        assert float(number) == pytest.approx(float(expected), rel=0, abs=tolerance), printed

"""docs/requirements/capture.txt suffices to record and be guided, in an environment that has what
it names and nothing else; no torch.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import distribution
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FIXTURE = ROOT / "fixtures" / "bumps"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
FOLDER = ROOT / "docs" / "requirements"
LINES = (FOLDER / "capture.txt").read_text(encoding="utf-8").splitlines()
NAMED = [line for line in LINES if not line.startswith("#")]
GUIDED = """
import sys
from pathlib import Path
from tests.capture.tui.driving import drive, running, see, shown

async def story(session, source):
    async with running(session, source) as pilot:
        await see(pilot, "continued, 0 views without cover")
        await pilot.press("ctrl+s")
        for words in ("[THROUGH COVER]", "Judged by picture, depth and", "This machine has no torch, so", "the plain guide serves"):
            await see(pilot, words)
        print(shown(pilot))

drive(story(Path(sys.argv[1]), sys.argv[2]))
print("torch" in sys.modules)
"""  # noqa: E501


def needed(requirement: str, visited: set[str]) -> Iterator[str]:
    """The distributions that a requirement brings in, without those of extras."""
    match = re.match(r"[\w.-]+", requirement)
    assert match
    name = match[0].lower().replace("_", "-")
    conditions = requirement.partition(";")[2]
    if (
        name in visited
        or "extra ==" in conditions
        or re.search(r"platform_system == .Windows|python_version < .3\.1[01]", conditions)
    ):
        return
    visited.add(name)
    yield name
    for further in distribution(name).requires or ():
        yield from needed(further, visited)


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the Python of an environment with the packages of the file, their dependencies, and
    both packages of the project.
    """
    folder = tmp_path_factory.mktemp("environment")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    visited: set[str] = set()
    for name in [name for requirement in NAMED for name in needed(requirement, visited)]:
        result = distribution(name)
        for entry in {
            file.parts[0]
            for file in result.files or ()
            if file.parts[0] not in ("..", "__pycache__")
        }:
            place = Path(str(result.locate_file(entry)))
            if place.exists() and not (packages / entry).exists():
                (packages / entry).symlink_to(place)
    for package in ("calib", "capture"):
        (packages / package).symlink_to(ROOT / package)
    return folder / "bin" / "python"


def run(python: Path, *words: str, path: Path | None = None) -> str:
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | (
        {"PYTHONPATH": str(path)} if path else {}
    )
    done = subprocess.run(
        [str(python), *words],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_every_line_is_one_of_the_project() -> None:
    assert set(NAMED) < set(PROJECT["dependencies"])


def test_the_file_for_all_names_extras_of_the_project() -> None:
    text = (FOLDER / "all.txt").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    (line,) = lines
    match = re.fullmatch(r"-e \.\[([\w,]+)\]", line)
    assert match
    assert set(match[1].split(",")) < PROJECT["optional-dependencies"].keys()


def test_the_environment_has_no_torch(python: Path) -> None:
    outcome = run(
        python,
        "-c",
        "from importlib.util import find_spec as f; print(*map(bool, map(f, ['cv2', 'torch',"
        " 'scipy', 'matplotlib'])))",
    )
    assert outcome.split() == ["True", "False", "False", "False"]


def test_a_session_is_recorded(python: Path, tmp_path: Path) -> None:
    options = (
        "--cover-from",
        str(FIXTURE / "session.yaml"),
        "--board",
        "9x9",
        "--square-mm",
        "20",
        "--json",
    )
    output = run(
        python,
        "-m",
        "capture",
        "record",
        str(tmp_path / "s"),
        "--source",
        f"folder:{FIXTURE / 'holdout'}?speed=max",
        *options,
    )
    assert json.loads(output)["views"] == len(list((tmp_path / "s" / "frames").iterdir())) >= 8


def test_cameras_are_listed(python: Path) -> None:
    assert set(json.loads(run(python, "-m", "capture", "sources", "--json"))) == {
        "cameras",
        "missing",
    }


@pytest.mark.slow
def test_the_plain_guide_leads(python: Path, tmp_path: Path) -> None:
    shutil.copy(FIXTURE / "session.yaml", tmp_path)
    output = run(python, "-c", GUIDED, str(tmp_path), f"folder:{FIXTURE / 'holdout'}", path=ROOT)
    assert output.splitlines()[-1] == "False"
    assert len(list((tmp_path / "frames").iterdir())) >= 1


@pytest.mark.parametrize("missing", NAMED)
def test_every_named_requirement_is_used(python: Path, tmp_path: Path, missing: str) -> None:
    """Without any one of them, the screen cannot be loaded."""
    name = re.match(r"\w+", missing)
    module = {"opencv": "cv2", "pyyaml": "yaml"}.get(name[0], name[0]) if name else ""
    code = (
        f"import sys; sys.modules['{module}'] = None\nimport capture.tui.app, capture.finder,"
        " capture.session_file, capture.coverage\n"
    )
    code += (
        "from capture.coverage import PlainGuide\nfrom calib.session.camera import Camera\nfrom"
        " calib.session.board import Board\n"
    )
    code += "PlainGuide(Board(9, 9, 0.02), Camera(640, 480)).next_pose([])"
    done = subprocess.run(
        [str(python), "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert re.search(rf"import of {module} halted|'{module}' is not a package", done.stderr)

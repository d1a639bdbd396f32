"""The installation without a checkout: the wheel holds both packages and nothing else, and its
commands run by themselves.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

from calib.version import VERSION

ROOT = Path(__file__).parents[1]
DATA = {
    "calib/export/blender_camera.txt",
    "calib/export/mitsuba_sensor.txt",
    "calib/fleet/fleet.css",
    "calib/py.typed",
    "calib/report/style.css",
    "capture/py.typed",
} | {
    path.relative_to(ROOT).as_posix()
    for folder in ("calib/report/web", "capture/web", "calib/demo")
    for path in (ROOT / folder).rglob("*")
    if path.is_file() and not path.name.startswith(".")
}
MAX_DEMO_BYTES = 1_500_000
LEFT_OUT = shutil.ignore_patterns(
    ".*", "__pycache__", "build", "dist", "*.egg-info", "fixtures", "docs"
)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built without the network from a copy of the checkout, in which no earlier build has left
    anything.
    """
    for module in ("build", "setuptools"):
        pytest.importorskip(
            module,
            reason=f"{module} builds the wheel and is not installed: pip install -e '.[dev]'",
        )
    source, out = tmp_path_factory.mktemp("source") / "refracal", tmp_path_factory.mktemp("dist")
    shutil.copytree(ROOT, source, ignore=LEFT_OUT)
    _run(source, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out))
    (built,) = out.iterdir()
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel in it, unpacked and with its scripts; what it depends on is where the
    tests have it from.
    """
    target = tmp_path_factory.mktemp("installed")
    _run(
        target,
        "-m",
        "pip",
        "install",
        "-q",
        "--no-index",
        "--no-deps",
        "--target",
        str(target),
        str(wheel),
    )
    return target


def test_the_wheel_holds_both_packages_and_nothing_else(wheel: Path) -> None:
    with ZipFile(wheel) as file:
        names = {name for name in file.namelist() if ".dist-info/" not in name}
    modules = {
        path.relative_to(ROOT).as_posix()
        for package in ("calib", "capture")
        for path in (ROOT / package).rglob("*.py")
    }
    assert names == modules | DATA
    assert wheel.name.startswith(f"refracal-{VERSION}-")


def test_the_wheel_has_the_session_of_the_demo(
    wheel: Path, installed: Path, tmp_path: Path
) -> None:
    with ZipFile(wheel) as file:
        sizes = [entry.file_size for entry in file.infolist() if "calib/demo/" in entry.filename]
    assert sum(sizes) < MAX_DEMO_BYTES
    copy = "from pathlib import Path; from calib.commands import demo_command as demo; "
    _run(tmp_path, "-c", f"{copy}demo.copy_session(Path('x'), overwrite=False)", path=installed)
    assert {path.name for path in (tmp_path / "x").iterdir()} > {"frames", "session.yaml"}
    assert len(list((tmp_path / "x" / "frames").glob("*.jpg"))) == 12


@pytest.mark.parametrize("command", ["calib", "capture"])
def test_the_commands_run_from_an_empty_folder(
    command: str, installed: Path, tmp_path: Path
) -> None:
    place = _run(tmp_path, "-c", f"import {command}; print({command}.__file__)", path=installed)
    assert Path(place.strip()) == installed / command / "__init__.py", "not the checkout's"
    assert _run(tmp_path, str(installed / "bin" / command), "--help", path=installed).startswith(
        f"usage: {command} "
    )
    assert not list(tmp_path.iterdir())


def _run(folder: Path, *words: str, path: Path | None = None) -> str:
    """Return the output of Python in a folder, with `path` before all installed packages."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    environment |= {"PYTHONPATH": str(path)} if path else {}
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout

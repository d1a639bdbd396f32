"""Test suites of other projects, as oracles: where they lie on this machine, and how they come.

Nothing of them is part of this project. Each is fetched into ~/.cache/refracal-suites, or
$REFRACAL_SUITES, a folder by its name.
"""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

CACHE = Path(os.environ.get("REFRACAL_SUITES", Path.home() / ".cache" / "refracal-suites"))


@dataclass(frozen=True, slots=True)
class Suite:
    name: str
    needs: str
    """The requirements of a machine that fetches it."""
    packages: tuple[str, ...]
    """The packages of PyPI, installed without what they depend on: Refracal's environment has the
    rest, and some would bring another OpenCV.
    """
    repository: str
    """The address of a git repository, if the suite is no package. Its packages then lie beside
    it.
    """
    tests: tuple[str, ...]
    """The arguments of pytest."""

    @property
    def folder(self) -> Path:
        return CACHE / self.name

    @property
    def packages_folder(self) -> Path:
        return CACHE / f"{self.name}-packages" if self.repository else self.folder

    @property
    def skipped(self) -> str:
        """The reason why a test is skipped if the suite is not there."""
        return f"{self.name} is not there: python -m tests.suites {self.name} fetches and runs it"

    def fetch(self) -> None:
        """Fetch what is not there; CalledProcessError if that fails."""
        if self.repository:
            clone = ["git", "clone", "--quiet", "--depth", "1", self.repository]
            fetch_into(self.folder, clone)
        if self.packages:
            install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps"]
            fetch_into(self.packages_folder, [*install, *self.packages, "--target"])


def fetch_into(folder: Path, command: list[str]) -> None:
    """Run a command, whose last argument will be a folder, unless that folder is there."""
    if folder.is_dir():
        return
    temporary = folder.with_name(f"{folder.name}.tmp")
    CACHE.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(temporary, ignore_errors=True)  # of a fetch that was interrupted
    subprocess.run([*command, str(temporary)], check=True)
    temporary.rename(folder)


AQUACAL = Suite(
    name="aquacal",
    needs="PyPI, 90 MB",
    packages=("aquacal", "natsort", "pandas", "six", "tqdm"),
    repository="",
    tests=("tests/suites/test_aquacal.py",),
)
CALIBMAR = Suite(
    name="calibmar",
    needs="git, github.com, PyPI, a C++ compiler",
    packages=("cmeel-eigen",),
    repository="https://github.com/MDSKiel/calibmar",
    tests=("tests/suites/test_calibmar.py", "tests/suites/test_colmap_ports.py"),
)
COLMAP = Suite(
    name="colmap",
    needs="PyPI, 40 MB",
    packages=("pycolmap",),
    repository="",
    tests=("tests/export/test_consumers.py", "-k", "pycolmap"),
)
NCORE = Suite(
    name="ncore",
    needs="PyPI, 45 MB",
    packages=(
        "nvidia-ncore",
        "asciitree",
        "cbor2",
        "dataclasses-json",
        "Deprecated",
        "fasteners",
        "marshmallow<4",
        "numcodecs<0.16",
        "pathlib_abc",
        "typing-inspect",
        "universal_pathlib",
        "wrapt",
        "zarr<3",
    ),
    repository="",
    tests=("tests/export/test_consumers.py", "-k", "ncore"),
)
NEWTON = Suite(
    name="newton",
    needs="PyPI, 480 MB",
    packages=("newton>=1.7", "warp-lang"),
    repository="",
    tests=("tests/suites/test_newton.py",),
)
SUITES = (AQUACAL, CALIBMAR, COLMAP, NCORE, NEWTON)

"""The parts of an emulated Pi. The program prints a root of Debian's arm64, a folder of aarch64
wheels, and an emulator, each made or found once.

`root`, `wheels` and `emulator` as arguments choose, in the order in which they are printed.
"""

import shutil
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

from tests.device.guest import PROJECT
from tests.device.kernels import BOOKWORM
from tests.device.packages import Apt, MissingError
from tests.device.skipped import SKIPPED
from tests.device.wheels import wheels

INDIRECT = (
    "filelock",
    "fsspec",
    "jinja2",
    "markdown-it-py",
    "markupsafe",
    "mdurl",
    "mpmath",
    "networkx",
    "pygments",
    "sympy",
)
"""The dependencies of torch and rich."""


def requirements() -> list[str]:
    """The project's own, as they are for aarch64."""
    written = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]["dependencies"]
    pieces = [requirement.partition(";") for requirement in written]
    return [
        wanted.strip()
        for wanted, _, marker in pieces
        if "!= 'aarch64'" not in marker and ">= '3.15'" not in marker
    ]


def emulator() -> Path:
    """Return this machine's emulator, or Debian's."""
    installed = shutil.which("qemu-aarch64-static") or shutil.which("qemu-aarch64")
    return (
        Path(installed)
        if installed
        else BOOKWORM.unpacked("qemu-user", alone=("qemu-user-static",))
        / "usr/bin/qemu-aarch64-static"
    )


PARTS: dict[str, Callable[[], Path]] = {
    "root": (
        lambda: Apt("trixie", "arm64").unpacked(
            "arm64", ("base-files", "python3", "python3-venv", "python3-libcamera", "libstdc++6")
        )
    ),
    "wheels": lambda: wheels(
        "wheels-aarch64", "aarch64", (*requirements(), *INDIRECT, "typing-extensions")
    ),
    "emulator": emulator,
}

if __name__ == "__main__":
    try:
        print(*(PARTS[name]() for name in sys.argv[1:] or PARTS))
    except MissingError as error:
        print(f"SKIPPED: {error}", file=sys.stderr)
        sys.exit(SKIPPED)

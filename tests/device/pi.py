"""What pi.sh needs: prints a root of Debian's arm64, a folder of aarch64 wheels, and an emulator, each made or found once."""

import shutil
import sys
import tomllib

from tests.device.guest import PROJECT
from tests.device.kernels import BOOKWORM
from tests.device.packages import Apt, MissingError
from tests.device.skipped import SKIPPED
from tests.device.wheels import wheels

INDIRECT = ("filelock", "fsspec", "jinja2", "markdown-it-py", "markupsafe", "mdurl", "mpmath", "networkx", "pygments", "sympy")
"""What torch and rich depend on."""


def requirements() -> list[str]:
    """The project's own, as they are for aarch64."""
    written = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]["dependencies"]
    parts = [requirement.partition(";") for requirement in written]
    return [wanted.strip() for wanted, _, marker in parts if "!= 'aarch64'" not in marker]


try:
    root = Apt("trixie", "arm64").unpacked("arm64", ("base-files", "python3", "libstdc++6"))
    imported = wheels("wheels-aarch64", "aarch64", (*requirements(), *INDIRECT, "typing-extensions"))
    installed = shutil.which("qemu-aarch64-static") or shutil.which("qemu-aarch64")
    emulator = installed or BOOKWORM.unpacked("qemu-user", alone=("qemu-user-static",)) / "usr/bin/qemu-aarch64-static"
except MissingError as error:
    print(f"SKIPPED: {error}", file=sys.stderr)
    sys.exit(SKIPPED)
print(root, imported, emulator)

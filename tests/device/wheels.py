"""Python packages for an interpreter that is not this one."""

import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.device.packages import MissingError, cache, seconds_left, versioned

OLDER = ("2_27", "2_26", "2_24", "2_17", "2_12", "2_5")
"""glibc versions, beside 2.28, that the wheels of Debian trixie's interpreter may name."""

UNREACHABLE = re.compile(r"Retrying \(|Max retries|[Tt]imed out|HTTP error|Proxy")


def wheels(name: str, architecture: str, requirements: Sequence[str]) -> Path:
    """A folder to import them from with Python 3.13; made once.

    Dependencies are not followed, as pip would judge them by this machine.
    """
    folder = cache() / versioned(name, requirements)
    if folder.exists():
        return folder
    print(
        f"Fetching {' '.join(requirements)} for Python 3.13 on {architecture} ...", file=sys.stderr
    )
    partial = folder.with_name(f"{folder.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    platforms = [
        word
        for glibc in ("2_28", *OLDER)
        for word in ("--platform", f"manylinux_{glibc}_{architecture}")
    ]
    options = [
        "--only-binary=:all:",
        "--no-deps",
        "--python-version",
        "3.13",
        *platforms,
        "--platform",
        f"manylinux2014_{architecture}",
    ]
    pip = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--disable-pip-version-check",
        "--timeout",
        "30",
        "--retries",
        "2",
        "--target",
        str(partial),
    ]
    try:
        done = subprocess.run(
            [*pip, *options, *requirements],
            capture_output=True,
            text=True,
            timeout=seconds_left(),
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise MissingError(
            f"pip took too long to fetch {' '.join(requirements)}: run the same command on a faster"
            " connection."
        ) from None
    if done.returncode:
        if not UNREACHABLE.search(done.stderr):
            raise RuntimeError(
                f"pip finds no {' '.join(requirements)} for Python 3.13 on"
                f" {architecture}:\n{done.stderr}"
            )
        raise MissingError("pip reaches no package index: these tests need one, or a filled cache.")
    return partial.rename(folder)


def capture_wheels() -> Path:
    """Return the wheels that `capture record` imports, for a guest of Debian trixie."""
    return wheels("wheels-x86_64", "x86_64", ("numpy", "opencv-python-headless", "pyyaml"))

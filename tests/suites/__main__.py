"""Suites of other projects: `python -m tests.suites [aquacal] [calibmar] [colmap] [ncore]
[newton]`, by default all.

Fetches each into ~/.cache/refracal-suites (or $REFRACAL_SUITES) and runs our tests that use it.
Exit code 1: a test failed. 77: a suite cannot be fetched on this machine; the others passed.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.suites.fetch import CACHE, SUITES, Suite

UNAVAILABLE = 77


def main(names: Sequence[str]) -> int:
    by_name = {suite.name: suite for suite in SUITES}
    if unknown := [name for name in names if name not in by_name]:
        print(f"There is no suite {unknown[0]}: choose from {', '.join(by_name)}.", file=sys.stderr)
        return 2
    codes = [run(by_name[name]) for name in names or by_name]
    return 1 if 1 in codes else max(codes)


def run(suite: Suite) -> int:
    """Fetch a suite, run its tests, and return the exit code."""
    print(f"{suite.name} (needs {suite.needs}), in {suite.folder}", flush=True)
    try:
        suite.fetch()
    except (OSError, subprocess.CalledProcessError) as error:
        print(f"{suite.name} cannot be fetched ({error}): it needs {suite.needs}.", flush=True)
        return UNAVAILABLE
    paths = (str(suite.folder), str(Path.cwd()), os.environ.get("PYTHONPATH", ""))
    command = [sys.executable, "-m", "pytest", "-q", "-rs", "-m", "slow or not slow", *suite.tests]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    environment["REFRACAL_SUITES"] = str(CACHE)
    return int(subprocess.run(command, check=False, env=environment).returncode != 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""The checks in one command: `python -m tests`. What follows is passed on to pytest; `-m slow` has
the tests that are left out here.

`--cov` reports in one figure how much of both packages the tests run: to count lines takes up to a
third of the time again. What tests run in processes of their own is not counted.
"""

import subprocess
import sys

STYLE = (["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"])
"""The checks that .pre-commit-config.yaml runs as well."""
WORKERS = "3"
"""On two cores: tests of the terminal UI and of processes wait for a tenth of their time."""
COVERAGE = ("--cov=calib", "--cov=capture", "--cov-report=")

if __name__ == "__main__":
    arguments = [argument for argument in sys.argv[1:] if argument != "--cov"]
    counted = len(arguments) < len(sys.argv) - 1
    pytest = [
        "pytest",
        "-n",
        WORKERS,
        "--dist",
        "loadfile",
        "-m",
        "not slow",
        *(COVERAGE if counted else ()),
        *arguments,
    ]
    for check in (*STYLE, pytest, *([["coverage", "report", "--format=total"]] if counted else ())):
        print("$", *check, flush=True)
        code = subprocess.run([sys.executable, "-m", *check], check=False).returncode
        if code:
            sys.exit(code)

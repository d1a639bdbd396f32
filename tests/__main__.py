"""The checks in one command: `python -m tests`. What follows is passed on to pytest; `-m slow` has
the tests that are left out here.

`--cov` reports in one figure how much of both packages the tests run: to count lines takes up to a
third of the time again. What tests run in processes of their own is not counted.
"""

import subprocess
import sys

STYLE = (["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"])
"""The checks that .pre-commit-config.yaml runs as well. mypy, which has one core and no cache in a
clean checkout, runs beside the tests.
"""
WORKERS = "3"
"""On two cores: tests of the terminal UI and of processes wait for a tenth of their time."""
COVERAGE = ("--cov=calib", "--cov=capture", "--cov-report=")


def run(*command: str) -> None:
    """Run a module with its arguments, and end with its code if it fails."""
    print("$", *command, flush=True)
    code = subprocess.run([sys.executable, "-m", *command], check=False).returncode
    if code:
        sys.exit(code)


if __name__ == "__main__":
    arguments = [argument for argument in sys.argv[1:] if argument != "--cov"]
    counted = len(arguments) < len(sys.argv) - 1
    *quick, types = STYLE
    for check in quick:
        run(*check)
    mypy = subprocess.Popen(
        [sys.executable, "-m", *types], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        run(
            *("pytest", "-n", WORKERS, "--dist", "loadfile", "-m", "not slow"),
            *(COVERAGE if counted else ()),
            *arguments,
        )
    finally:
        print("$", *types, flush=True)
        print(mypy.communicate()[0], end="", flush=True)
    if mypy.returncode:
        sys.exit(mypy.returncode)
    if counted:
        run("coverage", "report", "--format=total")

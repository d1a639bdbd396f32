"""The checks in one command: `python -m tests`. What follows is passed on to pytest; `-m slow` has the tests that are left out here."""

import subprocess
import sys

STYLE = (["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"])
"""What .pre-commit-config.yaml runs too."""
COVERAGE = ("--cov=calib", "--cov=capture", "--cov-report=")
"""Reported below in one figure. What tests run in processes of their own is not counted."""

if __name__ == "__main__":
    pytest = ["pytest", "-n", "2", "--dist", "loadfile", "-m", "not slow", *COVERAGE, *sys.argv[1:]]
    for check in (*STYLE, pytest, ["coverage", "report", "--format=total"]):
        print("$", *check, flush=True)
        code = subprocess.run([sys.executable, "-m", *check], check=False).returncode
        if code:
            sys.exit(code)

"""Every check in one command: `python -m tests`. What follows is passed on to pytest."""

import subprocess
import sys

CHECKS = (["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"], ["pytest", "-n", "2", "--dist", "loadfile", *sys.argv[1:]])

for check in CHECKS:
    print("$", *check, flush=True)
    code = subprocess.run([sys.executable, "-m", *check], check=False).returncode
    if code:
        sys.exit(code)

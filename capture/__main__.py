"""`python -m capture` and the script `capture` are the command."""

import sys

from calib import __main__ as program


def run() -> int:
    """Run `capture` with the arguments of this process and return its exit code."""
    return program.run("capture")


if __name__ == "__main__":  # a process that this one starts looks in here first
    sys.exit(run())

"""Calibrates a camera that looks through a refractive cover, and undistorts its pictures at any depth.

stdout carries the result, stderr the progress and remarks. Exit codes: 0 done, 1 a bug, 2 wrong usage or input, 3 not enough good
data.
"""

from collections.abc import Sequence

from calib.command_line import run_command
from calib.commands import diagnose, evaluate, export, fit, importing, measure, report, undistort

COMMANDS = (fit, evaluate, diagnose, report, undistort, measure, export, importing)
"""In the order of the help."""


def main(argv: Sequence[str] | None = None) -> int:
    """The command `calib`; returns its exit code."""
    return run_command("calib", __doc__, COMMANDS, argv)

"""Calibrates a camera that looks through a refractive cover, and undistorts its pictures at any
depth.

stdout carries the result, stderr the progress and remarks. Exit codes: 0 done, 1 a bug, 2 wrong
usage or input, 3 not enough good data, 5 a calibration that was checked is not valid, 6 a fleet's
cluster is gone, or none of its workers can start, before all cameras were done.
"""

from collections.abc import Sequence

from calib.commands import (
    batch_command,
    board_command,
    check_command,
    diagnose_command,
    evaluate_command,
    export_command,
    fit_command,
    fleet_prior_command,
    immerse_command,
    import_command,
    measure_command,
    pose_command,
    report_command,
    undistort_command,
)
from calib.commands.command_line import run_command

COMMANDS = (
    fit_command,
    evaluate_command,
    check_command,
    diagnose_command,
    batch_command,
    fleet_prior_command,
    report_command,
    undistort_command,
    measure_command,
    pose_command,
    immerse_command,
    export_command,
    import_command,
    board_command,
)
"""In the order of the help."""


def main(argv: Sequence[str] | None = None) -> int:
    """The command `calib`; returns its exit code."""
    return run_command("calib", __doc__, COMMANDS, argv)

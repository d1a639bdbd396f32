"""The program `calib`."""

from collections.abc import Sequence

from calib.commands import (
    batch_command,
    board_command,
    check_command,
    demo_command,
    diagnose_command,
    evaluate_command,
    export_command,
    fit_command,
    fleet_prior_command,
    immerse_command,
    import_command,
    init_command,
    measure_command,
    pose_command,
    report_command,
    rig_command,
    stream_command,
    undistort_command,
)
from calib.commands.command_line import run_command
from calib.commands.parser import CommandGroup

DESCRIPTION = """
Calibrate a camera behind a glass cover, such as a dome, window or cone, and straighten its
pictures.

calib COMMAND --help explains a command. A second program, capture SESSION, records pictures.
"""
EPILOG = """
stdout carries the result, stderr progress and remarks. Exit codes: 0 done, 1 a bug, 2 wrong usage
or input, 3 not enough good data, 4 the camera or the disk failed, 5 the checked calibration is
not valid, 6 the cluster of calib batch is gone.
"""
GROUPS = (
    CommandGroup("Begin", (demo_command, init_command, board_command, import_command)),
    CommandGroup(
        "Calibrate one camera",
        (fit_command, diagnose_command, evaluate_command, check_command, report_command),
    ),
    CommandGroup(
        "Use a calibration",
        (
            undistort_command,
            stream_command,
            export_command,
            measure_command,
            pose_command,
            immerse_command,
        ),
    ),
    CommandGroup("Calibrate several cameras", (rig_command, batch_command, fleet_prior_command)),
)
"""The commands in the order of the help."""
COMMANDS = tuple(command for group in GROUPS for command in group.commands)


def main(argv: Sequence[str] | None = None) -> int:
    """Run `calib` with these arguments and return its exit code."""
    return run_command("calib", DESCRIPTION, COMMANDS, argv, GROUPS, EPILOG)

"""Takes the pictures that a calibration needs, with any camera that this machine has.

stdout carries the result, stderr what to do next and remarks. Exit codes: 0 done, 1 a bug, 2 wrong usage or input, 3 not enough good
data, 4 the device failed.
"""

import os
from collections.abc import Sequence

from calib.command_line import run_command
from capture.commands import record, sources

COMMANDS = (record, sources)
"""In the order of the help."""


def main(argv: Sequence[str] | None = None) -> int:
    """The command `capture`; returns its exit code."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    return run_command("capture", __doc__, COMMANDS, argv)

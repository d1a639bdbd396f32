"""Takes the pictures that a calibration needs, with any camera that this machine has.

  capture SESSION                        the terminal UI: all the way to maps
  capture SESSION --serve                the same in a browser of this machine
  capture SESSION --serve --host 0.0.0.0 --port 8000
                                         in any browser that has the address
`capture ui --help` lists all options of these.

stdout carries the result, stderr what to do next and remarks. Exit codes: 0 done, 1 a bug, 2 wrong
usage or input, 3 not enough good data, 4 the device failed.
"""

import os
import sys
from collections.abc import Sequence

from calib.commands.command_line import run_command
from capture.commands import record, sources, ui

COMMANDS = (ui, record, sources)
"""The commands in the order of the help.

The first may go without its name: a first word that is no command's name is its SESSION.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command `capture`, and return its exit code."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    argv = sys.argv[1:] if argv is None else list(argv)
    if not argv:
        print(
            "capture: name a folder, which is made if need be: capture SESSION. capture --help"
            " lists the commands.",
            file=sys.stderr,
        )
        return 2
    names = {command.__name__.rpartition(".")[2] for command in COMMANDS}
    if argv[0].partition("=")[0] not in (*names, "-h", "--help", "--version", "--print-completion"):
        argv = ["ui", *argv]
    return run_command("capture", __doc__, COMMANDS, argv)

"""The program `capture`."""

import sys
from collections.abc import Sequence

from calib.commands.command_line import run_command
from calib.commands.printing import print_error
from calib.commands.standard_streams import prepare_streams
from calib.errors import meant
from capture.commands import record, sources, ui

DESCRIPTION = """
Record the pictures for a calibration, with any camera of this machine.

  capture SESSION                        the guiding screen: from the first picture to maps
  capture SESSION --serve                the same in a browser of this machine
  capture SESSION --serve --host 0.0.0.0 --port 8000
                                         in any browser that has the address
`capture SESSION --help` explains their options.
"""
EPILOG = """
stdout carries the result, stderr the next step and remarks. Exit codes: 0 done, 1 a bug, 2 wrong
usage or input, 3 not enough good data, 4 the camera or the disk failed.
"""
COMMANDS = (ui, record, sources)
"""The commands in the order of the help.

The name of the first may be omitted: an argument that names no command is its SESSION.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run `capture` with these arguments and return its exit code."""
    prepare_streams()
    argv = sys.argv[1:] if argv is None else list(argv)
    if not argv:
        print_error(
            "capture",
            "name a folder, which is made if need be: capture SESSION. capture --help lists the"
            " commands.",
        )
        return 2
    names = {command.__name__.rpartition(".")[2] for command in COMMANDS}
    close = meant(argv[0], sorted(names)) if argv[0] not in names else ""
    if close and len(argv) > 1 and not any(word.startswith("-") for word in argv[:2]):
        print_error("capture", f"{argv[0]} is not a command: did you mean {close}?")
        return 2
    if argv[0].partition("=")[0] not in (*names, "-h", "--help", "--version", "--print-completion"):
        argv = ["ui", *argv]
    return run_command("capture", DESCRIPTION, COMMANDS, argv, epilog=EPILOG)

"""Command lines that a person can type: a program stands there by its name if the shell finds it,
else by its path.
"""

import shlex
import sys
from pathlib import Path
from shutil import which

PROGRAMS = ("calib", "capture")


def runnable_command(command: str) -> str:
    """Return a command line, changed so that the shell runs the program of this installation.

    Without an active virtual environment, the shell does not find its programs by their names, or
    finds those of another installation.

    Args:
        command: a command line that begins with the name of a program.
    """
    program, blank, arguments = command.partition(" ")
    return f"{shlex.quote(_locate_program(program))}{blank}{arguments}"


def _locate_program(program: str) -> str:
    """Return the program's name if the shell finds the one of this installation, else its path."""
    started = Path(sys.argv[0])
    neighbour = started if started.name in PROGRAMS else Path(sys.executable)
    installed = neighbour.with_name(program)
    if not installed.is_file():  # it runs as a module, so the name is the best guess
        return program
    path = which(program)
    return program if path and Path(path).samefile(installed) else str(installed)

"""How a person who started this program can start its commands: by their names where the shell
finds them, else by their places.
"""

import shlex
import sys
from pathlib import Path
from shutil import which

PROGRAMS = ("calib", "capture")


def as_typed(command: str) -> str:
    """A command line that begins with the name of a program, as the shell runs that program of this
    very installation.

    Where a virtual environment is not activated, its programs are not found by their names, or
    others are.
    """
    program, blank, arguments = command.partition(" ")
    return f"{shlex.quote(_found(program))}{blank}{arguments}"


def _found(program: str) -> str:
    started = Path(sys.argv[0])
    beside = started if started.name in PROGRAMS else Path(sys.executable)
    own = beside.with_name(program)
    if not own.is_file():  # not installed as a program: nothing better is known
        return program
    named = which(program)
    return program if named and Path(named).samefile(own) else str(own)

"""The command `calib` as a person runs it, where the screen need not follow its progress: run to
its end, then read its output.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from capture.process import NICENESS

REMARKS = ("Take care: ", "Misfit of ")


@dataclass(frozen=True, slots=True)
class CommandResult:
    returncode: int
    stdout: str
    sentence: str
    """The last line on stderr: the reason of a failure."""
    remarks: Sequence[str]
    """The other lines on stderr that a person should know."""


def calib(arguments: Sequence[str]) -> CommandResult:
    """Run the command to its end. Blocks."""
    command = [sys.executable, "-m", "calib", *arguments]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        os.setpriority(os.PRIO_PROCESS, process.pid, NICENESS)
        out, err = process.communicate()
    lines = err.strip().splitlines() or [
        f"calib ended with {process.returncode} and printed nothing."
    ]
    remarks = [line for line in lines if line.startswith(REMARKS)]
    return CommandResult(process.returncode, out, lines[-1].removeprefix("calib: error: "), remarks)

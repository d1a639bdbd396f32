"""The command `calib` as a person runs it, for what the screen has no need to follow: run to its
end, then what it said.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from capture.process import NICENESS

REMARKS = ("Take care: ", "Misfit of ")


@dataclass(frozen=True, slots=True)
class Done:
    returncode: int
    stdout: str
    sentence: str
    """What it said last on stderr: why it failed."""
    remarks: Sequence[str]
    """What else it said there that a person should know."""


def calib(arguments: Sequence[str]) -> Done:
    """Run it to its end. Blocks."""
    command = [sys.executable, "-m", "calib", *arguments]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        os.setpriority(os.PRIO_PROCESS, process.pid, NICENESS)
        out, err = process.communicate()
    lines = err.strip().splitlines() or [f"calib ended with {process.returncode} and said nothing."]
    remarks = [line for line in lines if line.startswith(REMARKS)]
    return Done(process.returncode, out, lines[-1].removeprefix("calib: "), remarks)

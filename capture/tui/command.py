"""The command `calib` as a person runs it, where the screen need not follow its progress: run to
its end, then read its output.
"""

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from capture.process import NICENESS

PROGRESS = re.compile(r" [0-9]+/[0-9]+ +[0-9-]+:[0-9-]{2}:[0-9-]{2}")
"""A part of a line on stderr that is the last state of a progress bar."""


@dataclass(frozen=True, slots=True)
class CommandResult:
    returncode: int
    stdout: str
    sentence: str
    """The last line on stderr, the reason of a failure; empty after a success."""
    remarks: Sequence[str]
    """The lines on stderr before that of a failure: notes, warnings, and how exact files are."""


def calib(arguments: Sequence[str]) -> CommandResult:
    """Run the command to its end. Blocks."""
    command = [sys.executable, "-m", "calib", *arguments]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        os.setpriority(os.PRIO_PROCESS, process.pid, NICENESS)
        out, err = process.communicate()
    lines = [line for line in err.strip().splitlines() if not PROGRESS.search(line)]
    if not process.returncode:
        return CommandResult(0, out, "", lines)
    *remarks, reason = lines or [f"calib ended with {process.returncode} and printed nothing."]
    return CommandResult(process.returncode, out, reason.removeprefix("calib: error: "), remarks)

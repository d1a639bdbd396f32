"""`calib` as a person runs it, in a process of its own."""

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from capture.tui.fitting import NICENESS


@dataclass(frozen=True, slots=True)
class Done:
    returncode: int
    stdout: str
    sentence: str
    """What it said last on stderr: why it failed."""


class Calib:
    """Run by `run`, ended by `kill` from any thread."""

    def __init__(self, arguments: Sequence[str]) -> None:
        command = [sys.executable, "-m", "calib", *arguments]
        self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        os.setpriority(os.PRIO_PROCESS, self._process.pid, NICENESS)

    def run(self) -> Done:
        """Wait for its end. Blocks."""
        with self._process:
            out, err = self._process.communicate()
        lines = err.strip().splitlines() or [f"calib ended with {self._process.returncode} and said nothing."]
        return Done(self._process.returncode, out, lines[-1].removeprefix("calib: "))

    def kill(self) -> None:
        self._process.kill()

"""A process of its own that says how far it is, a JSON object a line; when it dies, that is an event too."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from tempfile import TemporaryFile
from typing import IO, Any

Event = Mapping[str, Any]
"""With `event`: task (title, total), step (done, words), result, or error (sentence)."""


class Child:
    """Started by `events`, ended by `kill` from any thread."""

    def __init__(self, module: str, arguments: Sequence[str]) -> None:
        self._command = (sys.executable, "-m", module, *arguments)
        self._process: subprocess.Popen[str] | None = None
        self.killed = False

    @property
    def pid(self) -> int:
        """0 before it is started."""
        return self._process.pid if self._process else 0

    def events(self) -> Iterator[Event]:
        """Ends with a result or an error, but for a child that was killed by `kill`."""
        with TemporaryFile("w+") as errors:
            if self.killed:
                return
            with subprocess.Popen(
                self._command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors, text=True
            ) as self._process:
                if self.killed:
                    self._process.kill()
                assert self._process.stdout
                last: Event = {}
                for line in self._process.stdout:
                    last = json.loads(line)
                    yield last
            if not self.killed and last.get("event") not in ("result", "error"):
                yield {"event": "error", "sentence": self._ending(self._process.returncode, _whole(errors))}

    def kill(self) -> None:
        self.killed = True
        if self._process:
            self._process.kill()

    def _ending(self, code: int, errors: str) -> str:
        if code < 0:
            name = signal.Signals(-code).name
            memory = ", perhaps for want of memory" if -code == signal.SIGKILL else ""
            return f"The process that calculates was ended from outside ({name}{memory}): start it again."
        lines = errors.strip().splitlines() or ["it said nothing"]
        return f"The process that calculates ended early, which is a bug in capture ({lines[-1]}): start it again, or run calib fit."


def _whole(file: IO[str]) -> str:
    file.seek(0)
    return file.read()

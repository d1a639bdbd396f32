"""`capture record` as a person starts it, and what became of it."""

import hashlib
import json
import subprocess
import sys
import time
from pathlib import Path
from threading import Timer
from typing import Any

PATIENCE = 300.0  # s: on a busy machine, a guest needs a minute for its first picture


class Recording:
    def __init__(self, session: Path, source: str, *options: str) -> None:
        self._session = session
        self._begun = time.monotonic()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "capture", "record", session, "--source", source, "--json", *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def wait_for(self, picture: int) -> None:
        """Until that picture is there, or the recording has ended."""
        file = self._session / "frames" / f"{picture:04d}.png"
        deadline = time.monotonic() + PATIENCE
        while self.running and not file.exists() and time.monotonic() < deadline:
            time.sleep(0.01)

    def ended(self, since: float | None = None) -> dict[str, Any]:
        """Exit code, seconds it took (from its start or `since` by the monotonic clock), and what it said and wrote.

        A recording that goes on for too long is killed.
        """
        timer = Timer(PATIENCE, self._process.kill)
        timer.start()
        stdout, stderr = self._process.communicate()
        timer.cancel()
        return {
            "code": self._process.returncode,
            "seconds": time.monotonic() - (since or self._begun),
            "stderr": stderr,
            "summary": json.loads(stdout) if stdout else None,
            "pictures": pictures(self._session),
        }


def pictures(session: Path) -> dict[str, str]:
    """Each picture's name and a digest of its file."""
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted((session / "frames").glob("*.png"))}

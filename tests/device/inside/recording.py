"""`capture record` as a person starts it, and what became of it.

A guest may be as slow as it likes, if it goes on.
"""

import hashlib
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

PATIENCE = (
    300.0  # s without a further picture: on a busy machine, a guest needs a minute for its first
)


class Recording:
    def __init__(self, session: Path, source: str, *options: str) -> None:
        self._session = session
        self._begun = self._changed = time.monotonic()
        self._count = 0
        self._process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "capture",
                "record",
                session,
                "--source",
                source,
                "--json",
                *options,
            ],
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
        while self.running and not file.exists():
            time.sleep(0.01)
            self._look()

    @property
    def count(self) -> int:
        """The number of pictures, of all cameras."""
        self._look()
        return self._count

    def interrupt(self) -> None:
        """End the recording as Ctrl-C does: it keeps its pictures."""
        if self.running:
            self._process.send_signal(signal.SIGINT)

    def ended(self, since: float | None = None) -> dict[str, Any]:
        """Exit code, seconds it took (from its start or `since` by the monotonic clock), and what
        it said and wrote.

        A recording that brings no further picture is killed.
        """
        while True:
            try:
                stdout, stderr = self._process.communicate(timeout=0.2)
                break
            except subprocess.TimeoutExpired:
                self._look()
        return {
            "code": self._process.returncode,
            "seconds": time.monotonic() - (since or self._begun),
            "stderr": stderr,
            "summary": json.loads(stdout) if stdout else None,
            "pictures": pictures(self._session),
        }

    def _look(self) -> None:
        """Say on the console that there is a further picture, or end what brings none."""
        count = sum(1 for _ in self._session.rglob("frames/*.png"))
        if count != self._count:
            self._count, self._changed = count, time.monotonic()
            print(f"{self._session.name}: {count} pictures", flush=True)
        elif time.monotonic() - self._changed > PATIENCE:
            self._process.kill()


def pictures(session: Path) -> dict[str, str]:
    """Each picture's name and a digest of its file."""
    return {
        file.name: hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted((session / "frames").glob("*.png"))
    }

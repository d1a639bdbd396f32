"""The time until the terminal UI answers a key, and the rate of its pictures, while it detects
boards and refits.

    python -m benchmarks.screen [--keys 100] [--runs 3]

The UI runs in a pseudo-terminal of 80x24 on a recording of 20 frames a second, 1640x1232, made of a
fixture's pictures, in a session that
has twelve views already: every new view starts a refit in the guide's process. A key is answered
    when the screen's new words have come
out of the pseudo-terminal. The target: 95 of 100 keys within 100 ms, and 8 pictures a second.
"""

import argparse
import fcntl
import os
import pty
import re
import shutil
import signal
import struct
import sys
import termios
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

FIXTURE = Path(__file__).parents[1] / "fixtures" / "bumps"
RATE = 20.0  # frames a second
SAME = 12  # frames of each pose: the board is held still for 0.6 s
ROW = re.compile(rb"\x1b\[9;1H")
"""The sequence that begins a row of the picture, once each time the picture changes."""


class Terminal:
    """The UI at the other end of a pseudo-terminal."""

    def __init__(self, arguments: list[str]) -> None:
        self.out = bytearray()
        self._came = threading.Condition()
        self.pid, self._end = pty.fork()
        if self.pid == 0:
            os.environ |= {"TERM": "xterm-256color", "COLORTERM": "truecolor"}
            os.execv(sys.executable, [sys.executable, "-m", "capture", *arguments])
        fcntl.ioctl(self._end, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        threading.Thread(target=self._read, daemon=True).start()

    def press(self, key: str) -> None:
        os.write(self._end, key.encode())

    def wait(self, words: bytes, start: int, within_s: float = 60) -> float:
        """The monotonic time at which these words have come out after `begin` bytes."""
        with self._came:
            if not self._came.wait_for(lambda: self.out.find(words, start) >= 0, within_s):
                raise SystemExit(f"{words!r} never came:\n{self.out[-2000:]!r}")
            return time.monotonic()

    def end(self) -> None:
        os.kill(self.pid, signal.SIGTERM)
        os.waitpid(self.pid, 0)

    def _read(self) -> None:
        while True:
            try:
                data = os.read(self._end, 1 << 16)
            except OSError:  # it has ended
                return
            with self._came:
                self.out += data
                self._came.notify_all()


def record(folder: Path, seconds: float) -> None:
    """The fixture's other poses, each held for a while, over and over."""
    (folder / "frames").mkdir(parents=True)
    rows = ["file,time_s,sequence"]
    pictures = sorted((FIXTURE / "frames").glob("*.jpg"))[12:] + sorted(
        (FIXTURE / "holdout" / "frames").glob("*.jpg")
    )
    for number in range(int(seconds * RATE)):
        name = f"{number:05d}.jpg"
        (folder / "frames" / name).symlink_to(pictures[number // SAME % len(pictures)])
        rows.append(f"{name},{number / RATE},{number}")
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")


def run(keys: int) -> tuple[np.ndarray, float]:
    """(keys,) s until each was answered, and pictures a second."""
    with TemporaryDirectory() as place:
        session, camera = Path(place) / "session", Path(place) / "camera"
        record(camera, 30 + keys * 0.4)
        (session / "frames").mkdir(parents=True)
        shutil.copy(FIXTURE / "session.yaml", session)
        for picture in sorted((FIXTURE / "frames").glob("*.jpg"))[:12]:
            shutil.copy(picture, session / "frames")
        terminal = Terminal([str(session), "--source", f"folder:{camera}"])
        try:
            terminal.wait(b"Start", 0)
            time.sleep(1.0)
            terminal.press("\x13")
            terminal.wait(b"auto ON", 0)
            terminal.wait(b"TAKEN", 0)  # from here on, refits run
            start_time, from_byte = time.monotonic(), len(terminal.out)
            taken = []
            for number in range(keys):
                start = len(terminal.out)
                pressed = time.monotonic()
                terminal.press("a")
                taken.append(
                    terminal.wait(b"auto OFF" if number % 2 == 0 else b"auto ON", start) - pressed
                )
                time.sleep(
                    0.1 + 0.1 * np.random.default_rng(number).random()
                )  # in no step with the pictures
            seconds = time.monotonic() - start_time
            return np.array(taken), len(ROW.findall(terminal.out[from_byte:])) / seconds
        finally:
            terminal.end()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--keys", type=int, default=100)
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    for _ in range(args.runs):
        taken, rate = run(args.keys)
        median, high, worst = 1000 * np.percentile(taken, (50, 95, 100))
        load = os.getloadavg()[0]
        print(
            f"key {median:.0f} ms (median), {high:.0f} ms (95 %), {worst:.0f} ms (worst);"
            f" {rate:.1f} pictures a second; load {load:.1f}"
        )


if __name__ == "__main__":
    main()

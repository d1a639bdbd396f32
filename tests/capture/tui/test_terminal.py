"""The command in a real terminal of 80x24, by keys: from a source to maps, and again after the
connection was lost.
"""

import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.capture.tui.driving import CONE, HANGS_S
from tests.capture.tui.test_session import FIXTURE

if not shutil.which("tmux"):
    pytest.skip("tmux is not installed", allow_module_level=True)


class Tmux:
    """A separate terminal, in a separate server."""

    def __init__(self, socket: Path, command: list[str]) -> None:
        self._tmux = ["tmux", "-S", str(socket), "-f", "/dev/null"]
        self._do(
            "new-session",
            "-d",
            "-x",
            "80",
            "-y",
            "24",
            *command,
            ";",
            "set-option",
            "-g",
            "remain-on-exit",
            "on",
        )

    def press(self, *keys: str) -> None:
        for key in keys:
            self._do("send-keys", key)

    def write(self, text: str) -> None:
        self._do("send-keys", "C-u")
        self._do("send-keys", "-l", "--", text)
        self._do("send-keys", "Enter")

    def shown(self) -> str:
        """Return the text of the terminal. A line that the terminal broke is one line; lines that
        scrolled out at the top are included.
        """
        return self._do("capture-pane", "-p", "-J", "-S", "-")

    def see(self, words: str) -> None:
        start_s = time.monotonic()
        while words not in " ".join(self.shown().split()):
            assert time.monotonic() - start_s < HANGS_S, f"{words!r} never came:\n{self.shown()}"
            time.sleep(0.2)

    def hang_up(self) -> None:
        """Kill the terminal, as when a connection is lost."""
        subprocess.run([*self._tmux, "kill-server"], check=False, capture_output=True)

    def _do(self, *arguments: str) -> str:
        return subprocess.run(
            [*self._tmux, *arguments], check=True, capture_output=True, text=True
        ).stdout


@pytest.fixture
def terminals() -> Iterator[list[Tmux]]:
    opened: list[Tmux] = []
    yield opened
    for terminal in opened:
        terminal.hang_up()


@pytest.mark.slow
def test_from_a_source_to_maps_over_a_lost_connection(
    tmp_path: Path, terminals: list[Tmux]
) -> None:
    session = tmp_path / "session"
    command = [sys.executable, "-m", "capture", str(session)]
    first = Tmux(tmp_path / "first", [*command, "--source", f"folder:{FIXTURE / 'bare'}"])
    terminals.append(first)
    first.see("Where pictures come from")
    first.press("Tab", "Tab", "Tab")
    for text in ("9", "9", "20"):
        first.write(text)
    first.press("Enter")
    first.see("cylinder")
    first.press("c", "Enter")  # the shape is a cone
    first.see("inner_radius_mm")
    first.press("Tab")
    for text in CONE:
        first.write(text)
    first.press("C-s")
    first.see("[WITHOUT COVER]")
    first.see("no more pictures")
    first.see("12 views")
    first.hang_up()

    second = Tmux(tmp_path / "second", [*command, "--source", f"folder:{FIXTURE}"])
    terminals.append(second)
    second.see("continued, 12 views without cover and 0 views through it")
    second.press("Enter")
    second.see("[THROUGH COVER]")
    second.see("Press f to fit")
    second.press("f")
    second.see("The error fell from 0.4")
    second.press("x")
    second.see("Maps that undistort pictures")
    for key in ("C-u", "C-k", "1", "C-s"):
        second.press(key)
    second.see("Wrote")
    assert (session / "export" / "map_1m.npz").exists()
    second.press("Escape")
    second.see("d Drop")
    second.press("q")
    second.see(f"The calibration is in {session / 'calibration'}")
    second.see(f"Exported {session / 'export' / 'map_1m.npz'}")
    second.see(
        f"Next: calib undistort {session / 'calibration'} {session / 'frames'} --depth 1"
        f" --crop 0 -o {session / 'undistorted'}"
    )

    third = Tmux(
        tmp_path / "third", [str(Path(sys.executable).with_name("capture")), str(session)]
    )  # as pip installs it
    terminals.append(third)
    third.see("12 views through it")
    third.press("C-r")
    third.see("The error fell from 0.4")

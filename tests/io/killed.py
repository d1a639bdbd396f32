"""Code that kills its own process at its n-th change of a folder, which Python's audit events tell
of: a naming, a renaming, a removal.
"""

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

CHANGES = ("os.link", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.symlink")


def on_change(folder: Path, act: Callable[[], object]) -> None:
    """Call it before every change of the folder that this process makes from now on; that a file is
    opened to be written is one.
    """
    home = str(folder)

    def look(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open":
            path, _, flags = arguments
            if home in str(path) and isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR):
                act()
        elif event in CHANGES and (
            event == "os.link" or any(home in str(item) for item in arguments[:2])
        ):
            act()

    sys.addaudithook(look)


def kill_at(change: int, folder: Path) -> None:
    """The number of changes that it lives to make."""
    made = 0

    def count() -> None:
        nonlocal made
        if made == change:
            os.kill(os.getpid(), signal.SIGKILL)
        made += 1

    on_change(folder, count)

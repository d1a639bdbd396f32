"""A served app ends with its server, however the server ends: an app that remains would hold the
session and its camera.
"""

import os
import signal
import threading
import time

SERVER = "REFRACAL_SERVER"
"""The environment variable with the number of the process that serves this one."""
POLL_S = 0.5
GRACE_S = 5.0
"""The time in s that the app gets to end by itself."""


def is_served() -> bool:
    """True if a process serves this one."""
    return bool(os.environ.get(SERVER))


def end_with_server() -> None:
    """Watch the server from now on, if there is one."""
    if number := os.environ.get(SERVER, ""):
        threading.Thread(target=_watch, args=(int(number),), daemon=True).start()


def _watch(server: int) -> None:
    while _is_running(server):
        time.sleep(POLL_S)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE_S)
    os.kill(os.getpid(), signal.SIGKILL)


def _is_running(process: int) -> bool:
    """True if the process runs. A zombie does not."""
    try:
        with open(f"/proc/{process}/stat", "rb") as file:  # noqa: PTH123 - as quick as can be
            return file.read().rpartition(b")")[2].split()[:1] != [b"Z"]
    except FileNotFoundError:
        pass
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True

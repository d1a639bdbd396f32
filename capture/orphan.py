"""An app that is served ends with its server, however that ends: one that is left over would hold
the session and its camera.
"""

import os
import signal
import threading
import time

SERVER = "REFRACAL_SERVER"
"""In the environment: the process that serves this one."""
LOOK_S = 0.5
GRACE_S = 5.0
"""For the app to end by itself."""


def end_with_server() -> None:
    """From now on, if there is a server."""
    if number := os.environ.get(SERVER, ""):
        threading.Thread(target=_watch, args=(int(number),), daemon=True).start()


def _watch(server: int) -> None:
    while _lives(server):
        time.sleep(LOOK_S)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE_S)
    os.kill(os.getpid(), signal.SIGKILL)


def _lives(process: int) -> bool:
    """Whether it runs; one that nobody has waited for does not."""
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

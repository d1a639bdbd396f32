"""A function in a separate process: its heavy libraries, its memory and its death stay there.

The process is a fresh interpreter (multiprocessing's spawn), because a copy of a process with
threads may hang. Both ends of one connection send each other Python objects. Nothing that the
function or its libraries print reaches the terminal, which may show a screen: stdout is discarded,
and the last line of stderr is kept as the reason of a failure.
"""

import os
import signal
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import recv_handle, send_handle
from tempfile import TemporaryFile
from threading import Lock
from types import TracebackType
from typing import Any, Self

NICENESS = 10  # the screen and the camera have priority
EXIT_S = 10.0  # s, after which a process that has closed its connection and does not exit is killed

_SPAWN = get_context("spawn")
_CHILDREN = Lock()
"""A lock that is held while a process is started, killed or waited for: when multiprocessing starts
one, it collects others that have ended.
"""


def prepare_processes() -> None:
    """Prepare processes for use within a Textual app. Call it before the app runs.

    The first process starts multiprocessing's tracker, which inherits sys.stderr; the app's
    replacement of sys.stderr has no file to inherit.
    """
    resource_tracker.ensure_running()


@dataclass(frozen=True, slots=True)
class Ending:
    """The end of a process."""

    by_signal: bool
    """True if a signal killed it, perhaps from the system; False if it ended by itself."""
    reason: str
    """The name of the signal, or the last line of stderr."""


class Process:
    """A running process. Leaving its `with` kills it, and so does the end of this process."""

    def __init__(self, work: Callable[..., None], *arguments: object) -> None:
        """`work` is a function of some module. The process calls it with the connection's other end
        and these arguments.

        The process imports that module by its name. The arguments and every message are pickled.
        """
        self._errors = TemporaryFile()  # noqa: SIM115 - closed by end
        self._connection, child_end = _SPAWN.Pipe()
        self._process = _SPAWN.Process(target=_run, args=(child_end,), daemon=True)
        self._ending: Ending | None = None
        with _CHILDREN:
            self._process.start()
        child_end.close()
        assert self._process.pid
        self.pid = self._process.pid
        with suppress(OSError):  # the process has died already
            send_handle(self._connection, self._errors.fileno(), self.pid)
        self.send((work, arguments))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.kill()
        self.end()

    def send(self, message: object) -> None:
        """Send a message. A process that has died gets nothing; `receive` detects that."""
        with suppress(OSError):
            self._connection.send(message)

    def receive(self) -> Any:
        """Return the next message. Blocks.

        Raises:
            EOFError: the process has ended or is about to, so no message comes; `end` says how.
        """
        try:
            return self._connection.recv()
        except OSError as error:  # the process was killed in the middle of a message
            raise EOFError from error

    def kill(self) -> None:
        """Kill the process, from any thread. A caller that waits in `receive` then gets
        EOFError.
        """
        with _CHILDREN:
            if self._ending is None:
                self._process.kill()

    def end(self) -> Ending:
        """Wait until a process that sends no more messages has exited, and release its
        resources.
        """
        if self._ending:
            return self._ending
        wait([self._process.sentinel], EXIT_S)
        with _CHILDREN:
            self._process.kill()
            self._process.join()
            code = self._process.exitcode or 0
            self._process.close()
            self._ending = Ending(code < 0, _signal(-code) if code < 0 else self._last_line())
        self._connection.close()
        self._errors.close()
        return self._ending

    def _last_line(self) -> str:
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else "it printed nothing"


def _signal(number: int) -> str:
    name = signal.Signals(number).name
    return f"{name}, perhaps for want of memory" if number == signal.SIGKILL else name


def _run(connection: Connection) -> None:
    """Run in the process: redirect its output away from the terminal, then do the work."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1, 2):
        os.dup2(nowhere, standard)
    os.dup2(recv_handle(connection), 2)
    os.nice(NICENESS)
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    work, arguments = connection.recv()
    work(connection, *arguments)

"""A function in a process of its own: the heavy libraries that it loads, its memory and its death
stay there.

The process is a fresh interpreter (multiprocessing's spawn), for a copy of one with threads may
hang. Both ends of one connection send each other Python objects. What the function prints, or a
library under it, never reaches the terminal, on which a screen may stand: stdout goes nowhere, and
of stderr the last line is kept as the process's last words.
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

NICENESS = 10  # the screen and the camera go first
EXIT_S = 10.0  # after which a process that has closed its connection and does not exit is killed

_SPAWN = get_context("spawn")
_CHILDREN = Lock()
"""Held while a process is started, killed or waited for: as multiprocessing starts one, it collects
others that have ended.
"""


def prepare() -> None:
    """Make processes possible from within a Textual app; to be called before it runs.

    The first of them starts multiprocessing's tracker, which inherits sys.stderr; the app's
    stand-in for that has no file to inherit.
    """
    resource_tracker.ensure_running()


@dataclass(frozen=True, slots=True)
class Ending:
    """How a process ended."""

    by_signal: bool
    """Killed, perhaps by the system, rather than having come to an end by itself."""
    words: str
    """The signal, or the last line of stderr."""


class Process:
    """One that runs. Leaving its `with` kills it, and so does the end of this process."""

    def __init__(self, work: Callable[..., None], *arguments: object) -> None:
        """`work`: a function of some module, called in the process with the connection's other end
        and these arguments.

        The process imports that module by its name; the arguments, and every message, are pickled.
        """
        self._errors = TemporaryFile()  # noqa: SIM115 - closed by end
        self._connection, theirs = _SPAWN.Pipe()
        self._process = _SPAWN.Process(target=_begin, args=(theirs,), daemon=True)
        self._ending: Ending | None = None
        with _CHILDREN:
            self._process.start()
        theirs.close()
        assert self._process.pid
        self.pid = self._process.pid
        with suppress(OSError):  # it has died already
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
        """To a process that has died, nothing is sent: `receive` finds that."""
        with suppress(OSError):
            self._connection.send(message)

    def receive(self) -> Any:
        """The next message. Blocks.

        Raises:
            EOFError: there is none, for the process has ended or is about to; `end` says how.
        """
        try:
            return self._connection.recv()
        except OSError as error:  # it was killed in the middle of a message
            raise EOFError from error

    def kill(self) -> None:
        """From any thread; who waits in `receive` then finds that there is nothing more."""
        with _CHILDREN:
            if self._ending is None:
                self._process.kill()

    def end(self) -> Ending:
        """Wait until a process that has no more to say has exited, and let go of it."""
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
        said = self._errors.read().decode(errors="replace").strip().splitlines()
        return said[-1] if said else "it said nothing"


def _signal(number: int) -> str:
    name = signal.Signals(number).name
    return f"{name}, perhaps for want of memory" if number == signal.SIGKILL else name


def _begin(connection: Connection) -> None:
    """In the process: nothing of it reaches the terminal; then the work."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1, 2):
        os.dup2(nowhere, standard)
    os.dup2(recv_handle(connection), 2)
    os.nice(NICENESS)
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    work, arguments = connection.recv()
    work(connection, *arguments)

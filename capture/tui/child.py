"""Work in a separate process that reports its progress; its death is an event too."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from calib.errors import RefracalError
from calib.progress import Advance
from capture.process import Ending, Process

Event = Mapping[str, Any]
"""An event with the key `event`: task (title, total), step (done, words), result (the work's return
value), or error (sentence).
"""
Work = Callable[..., Mapping[str, object]]
"""A function that runs in the process, with a calib.progress.Progress and its arguments.

The process imports it by its module and name.
"""
MOVE_IT = "move it to another folder, and try again"
"""The screen has no --overwrite: a person who wants that uses the command line."""
LOADING = "Loading (some seconds)"
"""The title of the first task of most works: it has one step, so its bar does not move
meanwhile.
"""


class Child:
    """A child process: `events` starts it, `kill` ends it from any thread."""

    def __init__(self, work: Work, *arguments: object) -> None:
        self._work = work
        self._arguments = arguments
        self._process: Process | None = None
        self.killed = False

    @property
    def pid(self) -> int:
        """The process's number; 0 before it is started."""
        return self._process.pid if self._process else 0

    def events(self) -> Iterator[Event]:
        """Yield the events. The last is a result or an error, unless `kill` ended the child."""
        if self.killed:
            return
        with Process(_run_work, self._work, *self._arguments) as self._process:
            if self.killed:
                self._process.kill()
            last: Event = {}
            with suppress(EOFError):
                while True:
                    last = self._process.receive()
                    yield last
            ending = self._process.end()
        if self.killed or last.get("event") in ("result", "error"):
            return
        yield {"event": "error", "sentence": _explain_ending(ending)}

    def kill(self) -> None:
        self.killed = True
        if self._process:
            self._process.kill()


def _explain_ending(ending: Ending) -> str:
    if ending.by_signal:
        return (
            f"The process that calculates was ended from outside ({ending.reason}): start it again."
        )
    return (
        f"The process that calculates ended early, which is a bug in capture ({ending.reason}):"
        " start it again, or run calib fit."
    )


class _Narrator:
    """The progress in the process, sent as events."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def say(self, event: str, **fields: object) -> None:
        self._connection.send({"event": event, **fields})

    def task(self, title: str, total: int) -> Advance:
        self.say("task", title=title, total=total)
        return lambda done, words: self.say("step", done=done, words=words)


def _run_work(connection: Connection, work: Work, *arguments: object) -> None:
    """Run in the process: do the work, then send its result or its error."""
    narrator = _Narrator(connection)
    try:
        narrator.say("result", **work(narrator, *arguments))
    except RefracalError as error:
        narrator.say("error", sentence=str(error))
    except ImportError as error:
        sentence = (
            f"This machine cannot fit ({error}): install torch, or copy the session and run calib"
            " fit there."
        )
        narrator.say("error", sentence=sentence)

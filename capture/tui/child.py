"""Work in a process of its own that says how far it is; when it dies, that is an event too."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from calib.errors import RefracalError
from calib.progress import Advance
from capture.process import Ending, Process

Event = Mapping[str, Any]
"""With `event`: task (title, total), step (done, words), result (what the work returns), or error
(sentence).
"""
Work = Callable[..., Mapping[str, object]]
"""Called in the process with a calib.progress.Progress and its arguments.

The process imports it by its module and name.
"""
MOVE_IT = "move it to another folder, and try again"
"""The screen has no --overwrite: a person who wants that uses the command line."""
LOADING = "Loading (some seconds)"
"""The first task of most works: it has one step, so its bar stands still meanwhile."""


class Child:
    """Started by `events`, ended by `kill` from any thread."""

    def __init__(self, work: Work, *arguments: object) -> None:
        self._work = work
        self._arguments = arguments
        self._process: Process | None = None
        self.killed = False

    @property
    def pid(self) -> int:
        """0 before it is started."""
        return self._process.pid if self._process else 0

    def events(self) -> Iterator[Event]:
        """Ends with a result or an error, but for a child that was killed by `kill`."""
        if self.killed:
            return
        with Process(_tell, self._work, *self._arguments) as self._process:
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
        yield {"event": "error", "sentence": _sentence(ending)}

    def kill(self) -> None:
        self.killed = True
        if self._process:
            self._process.kill()


def _sentence(ending: Ending) -> str:
    if ending.by_signal:
        return (
            f"The process that calculates was ended from outside ({ending.words}): start it again."
        )
    return (
        f"The process that calculates ended early, which is a bug in capture ({ending.words}):"
        " start it again, or run calib fit."
    )


class _Narrator:
    """In the process: progress as events."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def say(self, event: str, **what: object) -> None:
        self._connection.send({"event": event, **what})

    def task(self, title: str, total: int) -> Advance:
        self.say("task", title=title, total=total)
        return lambda done, words: self.say("step", done=done, words=words)


def _tell(connection: Connection, work: Work, *arguments: object) -> None:
    """In the process: the work, and its result or the sentence that it ended with."""
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

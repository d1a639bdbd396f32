"""The limits of one case: a limit on its work, which a busy machine does not shorten, and one on
its waiting.
"""

import faulthandler
import signal
import sys
from types import TracebackType

WORK_S, WAIT_S = 10.0, 60.0
DEEP_WORK_S, DEEP_WAIT_S = 60.0, 600.0
"""A report, an export and a verdict."""
STUCK = 2.0
"""Times the wait: code that even then did not come back to Python is where the whole run ends, with
all stacks on stderr.
"""


class Hang(BaseException):
    """A case that took too long. No `except Exception` stops it."""


class Limits:
    """A context that raises Hang in a case that works or waits for too long; only in the main
    thread, and on systems with POSIX signals.
    """

    def __init__(self, *, deep: bool = False) -> None:
        self.work_s, self.wait_s = (DEEP_WORK_S, DEEP_WAIT_S) if deep else (WORK_S, WAIT_S)
        for number in (signal.SIGPROF, signal.SIGALRM):
            signal.signal(number, _hang)

    def __enter__(self) -> None:
        faulthandler.dump_traceback_later(STUCK * self.wait_s, exit=True, file=sys.stderr)
        signal.setitimer(signal.ITIMER_PROF, self.work_s)
        signal.setitimer(signal.ITIMER_REAL, self.wait_s)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        faulthandler.cancel_dump_traceback_later()


def _hang(number: int, _frame: object) -> None:
    raise Hang("too much work" if number == signal.SIGPROF else "it waits")

"""The words of a stream without a screen, on stderr: sentences, and now and then the counts."""

import sys
import threading
import time

from calib.errors import harmless
from capture.narrator import SilenceRemarks
from capture.streaming.statistics import StreamStatistics

TERMINAL_S = 0.5
"""The time in s between two counts in a terminal, where each replaces the one before."""
LOG_S = 10.0
"""The time in s between two lines of counts in a file."""


class StreamNarrator:
    def __init__(self) -> None:
        self._silence = SilenceRemarks()
        self._lock = threading.Lock()
        self._counted_s = time.monotonic()
        self._open_line = False

    def tell(self, sentence: str) -> None:
        with self._lock:
            self._end_line()
            print(harmless(sentence), file=sys.stderr, flush=True)

    def report_silence(self, seconds: float) -> None:
        with self._lock:
            self._end_line()
            self._silence(seconds)

    def report_counts(self, statistics: StreamStatistics) -> None:
        in_terminal = sys.stderr.isatty()
        now_s = time.monotonic()
        if now_s - self._counted_s < (TERMINAL_S if in_terminal else LOG_S):
            return
        self._counted_s = now_s
        with self._lock:
            if in_terminal:
                print(f"\r\x1b[K{statistics.line()}", end="", file=sys.stderr, flush=True)
                self._open_line = True
            else:
                print(statistics.line(), file=sys.stderr, flush=True)

    def finish(self, statistics: StreamStatistics) -> None:
        """Print the counts of the whole stream."""
        with self._lock:
            self._end_line()
            print(statistics.line(), file=sys.stderr, flush=True)

    def _end_line(self) -> None:
        if self._open_line:
            print("\r\x1b[K", end="", file=sys.stderr)
            self._open_line = False

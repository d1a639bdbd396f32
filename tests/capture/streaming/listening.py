"""A listener that keeps what it is told."""

import time
from collections.abc import Callable

from capture.streaming.statistics import StreamStatistics

HANGS_S = 120.0
"""The time in s after which a test gives up, however busy the machine is."""


class Remarks:
    """The sentences of a stream, and functions that are called after each frame."""

    def __init__(self) -> None:
        self.sentences: list[str] = []
        self.silences: list[float] = []
        self.on_frame: Callable[[StreamStatistics], object] = lambda _: None

    def tell(self, sentence: str) -> None:
        self.sentences.append(sentence)

    def report_silence(self, seconds: float) -> None:
        self.silences.append(seconds)

    def report_counts(self, statistics: StreamStatistics) -> None:
        self.on_frame(statistics)


def wait_until(holds: Callable[[], object], what: str) -> None:
    """Wait until a condition holds."""
    start_s = time.monotonic()
    while not holds():
        assert time.monotonic() - start_s < HANGS_S, f"it never came: {what}"
        time.sleep(0.01)

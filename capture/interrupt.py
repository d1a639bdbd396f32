"""Ctrl-C, or a service's stop, as a wish to end: what is being written is finished first."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Wish:
    """Whether someone wished to end."""

    came = False


@contextmanager
def ending_by(stop: Callable[[], None]) -> Iterator[Wish]:
    """Within, the first SIGINT or SIGTERM calls `stop`, and a second one raises KeyboardInterrupt.

    For the main thread.
    """
    wish = Wish()

    def answer(number: int, _: object) -> None:
        signal.signal(number, signal.default_int_handler)
        wish.came = True
        stop()

    before = {number: signal.signal(number, answer) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield wish
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

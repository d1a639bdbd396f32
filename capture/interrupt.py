"""Ctrl-C, or a service's stop, as a request to stop: the program first finishes what it is
writing.
"""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class StopRequest:
    """A request to stop."""

    received = False


@contextmanager
def stop_on_signal(stop: Callable[[], None]) -> Iterator[StopRequest]:
    """Call `stop` at the first SIGINT or SIGTERM within the `with`; a second one raises
    KeyboardInterrupt.

    Only the main thread may enter it.
    """
    request = StopRequest()

    def handle(number: int, _: object) -> None:
        signal.signal(number, signal.default_int_handler)
        request.received = True
        stop()

    previous = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield request
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)

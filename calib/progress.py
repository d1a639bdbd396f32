"""The interface by which long work reports its progress."""

from collections.abc import Callable
from typing import Protocol

Advance = Callable[[int, str], None]
"""A function of the number of finished steps and a short remark."""


class Progress(Protocol):
    """A display of one progress bar after another."""

    def task(self, title: str, total: int) -> Advance:
        """Start a bar of `total` steps; the previous task has ended."""
        ...


class Silent:
    """A progress display that shows nothing."""

    def task(self, title: str, total: int) -> Advance:
        del title, total
        return _ignore


def _ignore(done: int, words: str) -> None:
    del done, words

"""How long work says how far it is, without knowing where that is shown."""

from collections.abc import Callable
from typing import Protocol

Advance = Callable[[int, str], None]
"""Called with how many steps are done, and a few words on how it goes."""


class Progress(Protocol):
    """Shows one bar after another."""

    def task(self, title: str, total: int) -> Advance:
        """Begin a task of `total` steps; the one before it has ended."""
        ...


class Silent:
    """Shows nothing."""

    def task(self, title: str, total: int) -> Advance:
        del title, total
        return _ignore


def _ignore(done: int, words: str) -> None:
    del done, words

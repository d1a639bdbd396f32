"""The interface by which long work reports its progress."""

from collections.abc import Callable
from typing import Protocol

from calib.errors import wrong_type

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


def check_progress(progress: object) -> None:
    """Raise WrongTypeError if this is no Progress."""
    if not callable(getattr(progress, "task", None)):
        raise wrong_type("progress", progress, "a calib.Progress, or calib.Silent()")


def _ignore(done: int, words: str) -> None:
    del done, words

"""Functions that print JSON and the names of files on stdout, and remarks and errors on stderr."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from calib.errors import harmless
from calib.io.json_text import json_text

if TYPE_CHECKING:
    from calib.verdict.verdict import Verdict

WARNING = "Take care"
"""The first words of a remark that is a warning."""


def print_json(mapping: Mapping[str, object]) -> None:
    """Print one JSON object on one line."""
    print(json_text(mapping))


def print_paths(paths: Iterable[Path]) -> None:
    """Print one path on each line, with control characters made harmless."""
    for path in paths:
        print(harmless(str(path)))


def print_remark(sentence: str) -> None:
    """Print a remark on stderr, behind a word that separates it from errors."""
    is_warning = sentence.startswith(WARNING)
    word = WARNING if is_warning else "Note:"
    text = sentence.removeprefix(WARNING) if is_warning else f" {sentence}"
    _print_behind(word, "yellow", harmless(text))


def print_error(program: str, message: str) -> None:
    """Print the error that ends a program, on stderr.

    Args:
        message: printable text; it may have several lines.
    """
    _print_behind(f"{program}: error:", "bold red", f" {message}")


def _print_behind(word: str, style: str, text: str) -> None:
    """Print a text on stderr behind a word, which a terminal shows in a style."""
    if not sys.stderr.isatty():  # without rich, which takes a tenth of a second to load
        try:
            print(f"{word}{text}", file=sys.stderr)
        except BrokenPipeError:  # nobody reads on: the work goes on
            drop(sys.stderr)
        return
    from rich.console import Console
    from rich.text import Text

    Console(stderr=True, soft_wrap=True).print(Text.assemble((word, style), text))


def drop(stream: TextIO) -> None:
    """Redirect a stream to nowhere, so that Python does not write its buffer again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def verdict_mapping(verdict: Verdict, written: Sequence[Path]) -> dict[str, object]:
    """Return the last keys of a result's JSON object: its verdict and the paths of its files."""
    return {"verdict": verdict.as_json(), "written": [str(path) for path in written]}

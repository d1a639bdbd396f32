"""Functions that print JSON and the names of files on stdout."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calib.errors import harmless
from calib.io.json_text import json_text

if TYPE_CHECKING:
    from calib.verdict.verdict import Verdict


def print_json(mapping: Mapping[str, object]) -> None:
    """Print one JSON object on one line."""
    print(json_text(mapping))


def print_paths(paths: Iterable[Path]) -> None:
    """Print one path on each line, with control characters made harmless."""
    for path in paths:
        print(harmless(str(path)))


def verdict_mapping(verdict: Verdict, written: Sequence[Path]) -> dict[str, object]:
    """Return the last keys of a result's JSON object: its verdict and the paths of its files."""
    return {"verdict": verdict.as_json(), "written": [str(path) for path in written]}

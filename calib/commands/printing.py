"""What goes to stdout: JSON, and names of files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calib.errors import harmless
from calib.io.json_text import json_text

if TYPE_CHECKING:
    from calib.verdict.verdict import Verdict


def print_json(mapping: Mapping[str, object]) -> None:
    """One object, on one line."""
    print(json_text(mapping))


def print_paths(paths: Iterable[Path]) -> None:
    """One on each line, whatever its name has."""
    for path in paths:
        print(harmless(str(path)))


def told(verdict: Verdict, written: Sequence[Path]) -> dict[str, object]:
    """What every result ends with: what is to be thought of it, and where it is."""
    return {"verdict": verdict.as_json(), "written": [str(path) for path in written]}

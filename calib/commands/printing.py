"""What goes to stdout: JSON that every reader takes, where a number that is not finite becomes null; and names of files."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calib.errors import harmless

if TYPE_CHECKING:
    from calib.verdict.verdict import Verdict


def print_json(mapping: Mapping[str, object]) -> None:
    """One object, on one line."""
    print(json.dumps(_finite(mapping), allow_nan=False))


def print_paths(paths: Iterable[Path]) -> None:
    """One on each line, whatever its name has."""
    for path in paths:
        print(harmless(str(path)))


def told(verdict: Verdict, written: Sequence[Path]) -> dict[str, object]:
    """What every result ends with: what is to be thought of it, and where it is."""
    return {"verdict": verdict.as_json(), "written": [str(path) for path in written]}


def _finite(value: object) -> object:
    match value:
        case float():
            return value if math.isfinite(value) else None
        case Mapping():
            return {key: _finite(entry) for key, entry in value.items()}
        case list() | tuple():
            return [_finite(entry) for entry in value]
    return value

"""The numbers that a page gives to its scripts, as JSON."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Data = Mapping[str, object]
"""Texts, numbers, lists and arrays that figures are drawn from."""

ESCAPES = {ord(letter): f"\\u{ord(letter):04x}" for letter in "<>&"}
"""Letters that could end the page's data, as JSON writes them inside a text."""


def to_json(data: Data) -> str:
    """Return JSON that may stand in a page. An array becomes {"shape": ..., "f4": ...} or, if it
    holds whole numbers, {"shape": ..., "u2": ...}: base64 of little-endian values.
    """
    text = json.dumps(data, default=_array, allow_nan=False, separators=(",", ":"))
    return text.translate(ESCAPES)


def _array(values: object) -> dict[str, object]:
    if not isinstance(values, np.ndarray):
        raise TypeError(f"{type(values).__name__} has no place in a page's data")
    kind = "u2" if np.issubdtype(values.dtype, np.integer) else "f4"
    return {"shape": values.shape, kind: _base64(values.astype(f"<{kind}"))}


def _base64(values: NDArray[np.generic]) -> str:
    return b64encode(values.tobytes()).decode()

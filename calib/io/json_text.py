"""JSON that every reader accepts: numbers that are not finite become null."""

import json
import math
from collections.abc import Mapping


def json_text(mapping: Mapping[str, object]) -> str:
    """Return a mapping as a JSON object on one line."""
    return json.dumps(_replace_non_finite(mapping), allow_nan=False)


def _replace_non_finite(value: object) -> object:
    match value:
        case float():
            return value if math.isfinite(value) else None
        case Mapping():
            return {key: _replace_non_finite(entry) for key, entry in value.items()}
        case list() | tuple():
            return [_replace_non_finite(entry) for entry in value]
    return value

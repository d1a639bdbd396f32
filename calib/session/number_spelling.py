"""Advice on texts that stand for a number in a file and are not one to YAML: 25,4 or 50+-5 or
25 mm.
"""

import math
import re
import unicodedata

from calib.session.typed_number import typed_number

PLAIN = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", re.ASCII)
"""A number as YAML reads it."""
NUMBER_START = re.compile(rf"({PLAIN.pattern})(.*)", re.ASCII | re.DOTALL)
DASHES = "−–—‐‑‒―﹣－"
"""Characters that look like the hyphen of a negative number."""
UNITS = {
    "mm": {
        **dict.fromkeys(("mm", "millimetres", "millimeters"), 1.0),
        "cm": 10.0,
        "m": 1000.0,
        **dict.fromkeys(("in", "inch", "inches", '"'), 25.4),
    },
    "deg": dict.fromkeys(("°", "deg", "degrees"), 1.0) | {"rad": 180 / math.pi},
    "px": dict.fromkeys(("px", "pixels", "pixel"), 1.0),
}
"""For the suffix of a key, the size of each unit that a text may have, in the key's own."""


def spelling_advice(key: str, text: str, *, has_sigma: bool) -> str:
    """Return what to write in place of a text that was meant as a number, as the end of a sentence;
    empty if it was not meant as one.

    Args:
        key: the key of the number, whose suffix names the unit.
        has_sigma: true if a mapping of a value and its sigma is allowed there.
    """
    word = text.strip()
    if PLAIN.fullmatch(word):
        return "drop the quotes"
    dash = next((character for character in word if character in DASHES), "")
    if dash and _is_number(hyphenated := word.replace(dash, "-")):
        name = unicodedata.name(dash).lower()
        return f"its {dash} is the character {name}: write {hyphenated} with a hyphen"
    if re.fullmatch(r"[-+]?[0-9]+,[0-9]+", word, re.ASCII):
        return f"write {word.replace(',', '.')} with a decimal point"
    if _is_number(word):
        return f"write {float(word):g}, in the digits 0 to 9 alone"
    pair = typed_number(word)
    if has_sigma and isinstance(pair, dict) and {*pair} == {"value", "sigma"}:
        return f"write {{value: {pair['value']:g}, sigma: {pair['sigma']:g}}}"
    return _without_unit(key, word)


def _without_unit(key: str, word: str) -> str:
    """Return the number of a text such as 2.5 cm in the unit of its key; empty if it has none."""
    match = NUMBER_START.fullmatch(word)
    suffix = re.sub(r"\[[0-9]+\]$", "", key).rpartition("_")[2]
    units = UNITS.get(suffix, UNITS["px"])
    size = units.get(match[5].strip().lower()) if match else None
    if not match or size is None:
        return ""
    return f"write {float(match[1]) * size:g} without a unit, which is that of the key"


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False

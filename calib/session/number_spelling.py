"""Advice on texts that stand for a number in a file and are not one to YAML: 25,4 or 50+-5 or
25 mm or water.
"""

import math
import re
import unicodedata

from calib.session.typed_number import join_sigmas

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
    "ms": {"ms": 1.0, "s": 1000.0},
    "px": dict.fromkeys(("px", "pixels", "pixel"), 1.0),
}
"""For the suffix of a key, the size of each unit that a text may have, in the key's own."""
INDICES = {
    **dict.fromkeys(("air", "vacuum"), 1.0),
    **dict.fromkeys(("water", "freshwater"), 1.333),
    **dict.fromkeys(("sea", "seawater", "saltwater", "ocean"), 1.34),
    **dict.fromkeys(("acrylic", "plexiglass", "plexiglas", "perspex", "pmma"), 1.49),
    **dict.fromkeys(("polycarbonate", "pc", "lexan", "makrolon"), 1.585),
    **dict.fromkeys(("glass", "sodalime", "floatglass"), 1.52),
    **dict.fromkeys(("borosilicate", "pyrex"), 1.47),
}
"""The refractive index of each material, by its name in small letters alone."""


def spelling_advice(key: str, text: str, *, has_sigma: bool, is_whole: bool = False) -> str:
    """Return what to write in place of a text that was meant as a number, as the end of a sentence;
    empty if it was not meant as one.

    Args:
        key: the key of the number, whose suffix names the unit.
        has_sigma: true if a mapping of a value and its sigma is allowed there.
        is_whole: true if only whole numbers are allowed there.
    """
    word = text.strip()
    if is_whole and re.search(r"[0-9],[0-9]", word):
        return ""  # 1920,5 px are no width: the limits say what is
    if key.endswith("index") and (index := material_index(word)):
        return f"write {index:g}, its refractive index"
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
    value, pair, sigma = join_sigmas(_pointed(word)).partition("±")
    number = _in_unit(key, value, _unit_of(sigma))
    uncertainty = _in_unit(key, sigma, _unit_of(value))
    if has_sigma and number is not None and uncertainty is not None:
        return f"write {{value: {number:g}, sigma: {uncertainty:g}}}"
    if pair or number is None:
        return ""
    return f"write {number:g} without a unit: the key says it"


def material_index(text: str) -> float | None:
    """Return the refractive index of a material by its name; None for any other text."""
    return INDICES.get(re.sub("[^a-z]", "", text.lower()))


def _unit_of(word: str) -> str:
    """Return the unit of a text such as 2.5 cm; empty if it has none."""
    match = NUMBER_START.fullmatch(word)
    return match[5].strip().lower() if match else ""


def _in_unit(key: str, word: str, default_unit: str) -> float | None:
    """Return the number of a text such as 2.5 cm in the unit of its key; None if it is no number.
    Without a unit it has the default one, or that of the key where this is empty.
    """
    match = NUMBER_START.fullmatch(word)
    suffix = re.sub(r"\[[0-9]+\]$", "", key).rpartition("_")[2]
    units = UNITS.get(suffix, UNITS["px"])
    size = units.get(_unit_of(word) or default_unit or next(iter(units)))
    return float(match[1]) * size if match and size is not None else None


def length_in_mm(text: str) -> float | None:
    """Return a length that has a unit, such as 50cm, in mm; None if the text is none."""
    word = _pointed(text.strip())
    length = _in_unit("mm", word, "") if _unit_of(word) else None
    return length if length and length > 0 else None


def _pointed(text: str) -> str:
    """Return a text with a point in place of each decimal comma."""
    return re.sub(r"(?<=[0-9]),(?=[0-9])", ".", text)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False

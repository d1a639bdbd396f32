"""Sentences that name keys, rewritten for a page with buttons: "press f to fit" becomes "touch Fit
to fit" where f's button has that label.
"""

import re
from collections.abc import Mapping

from calib.session.shapes.registry import find_shape, stated_shape_names
from capture.tui.form import BOARD

ARTICLES = "a", "i"
"""Keys that are words as well: they count as keys only after "press"."""
BEFORE_KEY = r"^|, | or | then | where |; |: |\. "
"""The text before a key without "press" before it."""
AFTER_KEY = r"(?= (?:to|again|for|then|there|[a-z]+s)\b|[,.;]|$)"
"""The text that follows such a key; a verb in the third person may."""
KEYBOARD_ONLY = (
    " enter opens the list, tab goes on.",
    "Enter begins to record.",
    " → completes it.",
    ", or press space",
    " Type --crop 0 for a picture with no black border.",
)
"""Sentences that mean nothing without a keyboard."""
NOT_KNOWN = "Touch 'not known' if you do not know."
WRITTEN_UNKNOWN = ", or unknown"
"""The end of a list of what a number may be; a page has a button for unknown."""
TOUCHED_UNKNOWN = ", or touch 'not known'"
FIELDS = {"source": "pictures from", "like (optional)": "copy settings from (optional)"}
"""The names of fields that a page explains more than a terminal has room for."""

LABELS = {
    "outside_index": "outside index: 1 in air, 1.333 in water",
    "axis_offset_mm": "axis offset x, z (mm)",
    "centre_mm": "centre x, y, z (mm)",
}
"""The labels of fields that say more than their names in sentences."""

LONG_KEYS = sorted(
    {key for keys in BOARD.values() for key in keys if "_" in key}
    | {
        dimension.quantity.key
        for shape in stated_shape_names()
        for dimension in find_shape(shape).keys
        if "_" in dimension.quantity.key
    }
)
"""The keys of the form that no sentence has as a word."""
KEY = re.compile(rf"\b(?:board|cover)\.([a-z_]+)|\b({'|'.join(LONG_KEYS)})\b")
"""Matches a key of session.yaml, with its section or without."""


def name_buttons(text: str, labels: Mapping[str, str]) -> str:
    """
    Args:
        text: one sentence or more.
        labels: the labels of the buttons, by their keys as sentences name them; keys without a
            label stay.
    """
    for sentence in KEYBOARD_ONLY:
        text = text.replace(sentence, "")
    text = text.replace("? if you do not know.", NOT_KNOWN)
    text = text.replace(WRITTEN_UNKNOWN, TOUCHED_UNKNOWN)
    text = text.replace("The set-up: ", "")
    text = re.sub(r"^source (?=is )", f"{readable_key('source')!r} ", text)
    text = re.sub(r"\b(in|correct) session\.yaml", r"\1 the Set-up", text)
    text = KEY.sub(lambda match: readable_key(match[1] or match[2]), text)
    pressed = re.sub(
        rf"\b(P|p)ress ({_alternatives(labels)})(?!\w)",
        lambda match: f"{_touch_verb(match[1])} {labels[match[2]]}",
        text,
    )
    keys = [key for key in labels if key not in ARTICLES]
    in_brackets = re.sub(
        rf"\(({_alternatives(keys)})\)", lambda match: f"({labels[match[1]]})", pressed
    )
    return re.sub(
        rf"({BEFORE_KEY})({_alternatives(keys)}){AFTER_KEY}",
        lambda match: match[1] + labels[match[2]],
        in_brackets,
    )


def readable_label(key: str) -> str:
    """Return the label of a field: its name in words, or what it has to say about its values."""
    return LABELS.get(key) or readable_key(key)


def readable_key(key: str) -> str:
    """Return the name of a field in words: "inner radius (mm)" for inner_radius_mm."""
    if key in FIELDS:
        return FIELDS[key]
    words = re.sub("_(mm|m|px)$", r" (\1)", re.sub("_deg$", " (degrees)", key))
    return words.replace("_", " ")


def _alternatives(keys: Mapping[str, str] | list[str]) -> str:
    return "|".join(map(re.escape, sorted(keys, key=len, reverse=True))) or r"(?!)"


def _touch_verb(letter: str) -> str:
    return "Touch" if letter == "P" else "touch"

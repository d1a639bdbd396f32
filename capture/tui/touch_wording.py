"""Sentences that name keys, for whom buttons are: "press f to fit" says "touch Fit to fit" where
f's button is called that.
"""

import re
from collections.abc import Mapping

ARTICLES = "a", "i"
"""Keys that are words as well: they are keys after "press" alone."""
ELSEWHERE = r"(?= (?:to|again|for|goes|leaves|then)\b|[,.]|$)"
"""What stands behind a key that is named without "press" before it."""


def worded(text: str, labels: Mapping[str, str]) -> str:
    """
    Args:
        text: a sentence or some.
        labels: what is written on the buttons, by their keys as sentences call them; keys that have
            none stay.
    """
    pressed = re.sub(
        rf"\b(P|p)ress ({_any(labels)})(?!\w)",
        lambda found: f"{_like(found[1])} {labels[found[2]]}",
        text,
    )
    bare = [key for key in labels if key not in ARTICLES]
    beside = re.sub(rf"\(({_any(bare)})\)", lambda found: f"({labels[found[1]]})", pressed)
    return re.sub(
        rf"(^|, | or |; |\. )({_any(bare)}){ELSEWHERE}",
        lambda found: found[1] + labels[found[2]],
        beside,
    )


def _any(keys: Mapping[str, str] | list[str]) -> str:
    return "|".join(map(re.escape, sorted(keys, key=len, reverse=True))) or r"(?!)"


def _like(letter: str) -> str:
    return "Touch" if letter == "P" else "touch"

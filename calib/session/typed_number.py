"""Numbers as people type them on a command line or in a form: `25`, or `25 +- 10` with a sigma."""

import re

COLOURS = re.compile(r"(.*?)((?:\s+(?:abbe|red|blue)\s+[0-9.]+)+)")
"""An index of refraction with its colours, such as `1.49 abbe 57`."""


def typed_number(text: str) -> object:
    """Return the number as session.yaml has it: `25 ± 10` (or `25 +- 10`) with its sigma, which is
    0 for an exact one, and `1.49 abbe 57` with its Abbe number. A text that is no number is
    returned as it is, and the rules refuse it.
    """
    if match := COLOURS.fullmatch(text.strip()):
        index = typed_number(match[1])
        words = match[2].split()
        colours = zip(words[::2], map(typed_number, words[1::2]), strict=True)
        return {**(index if isinstance(index, dict) else {"value": index}), **dict(colours)}
    value, pair, sigma = join_sigmas(text.strip()).partition("±")
    try:
        if pair:
            return {"value": float(value), "sigma": float(sigma)}
        return int(value) if value.lstrip("+-").isdecimal() else float(value)
    except ValueError:
        return text.strip() or None


def join_sigmas(text: str) -> str:
    """Return the text with every number and its sigma as one word."""
    return re.sub(r"\s*(±|\+-|\+/-)\s*", "±", text)

"""Numbers as people type them on a command line or in a form: `25`, or `25 +- 10` with a sigma."""

import re


def typed_number(text: str) -> object:
    """Return the number as session.yaml has it: `25 ± 10` (or `25 +- 10`) with its sigma, which is
    0 for an exact one. A text that is no number is returned as it is, and the rules refuse it.
    """
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

"""Whole numbers that somebody wrote as text."""

MOST_DIGITS = 15
"""Every count, size and frame number is shorter. Python's int() raises ValueError from 4301 digits
on.
"""


def whole_number(text: str) -> int | None:
    """Return the whole number of 0 or more that a text holds; None where it holds something else,
    or more than MOST_DIGITS digits.
    """
    return int(text) if text.isdecimal() and len(text) <= MOST_DIGITS else None

"""Check numbers that a person wrote as text, or that a program passed, and write depths."""

from calib.errors import WrongTypeError, brief

MAX_DIGITS = 15
"""Every count, size and frame number is shorter. Python's int() raises ValueError from 4301 digits
on.
"""


def whole_number(text: str) -> int | None:
    """Return the whole number of 0 or more that a text holds; None if it holds something else, or
    more than MAX_DIGITS digits.
    """
    return int(text) if text.isdecimal() and len(text) <= MAX_DIGITS else None


def real_number(value: object, name: str) -> float:
    """Return the value as a real number, which may be infinite or NaN; WrongTypeError if it is
    none.
    """
    try:
        if isinstance(value, str | bytes) or getattr(value, "ndim", None):
            raise TypeError
        return float(value)  # type: ignore[arg-type]  # whatever has __float__
    except (TypeError, ValueError, OverflowError):
        raise WrongTypeError(f"{name} is {brief(repr(value))}: give a real number.") from None


def counted(number: int, noun: str) -> str:
    """Return a count in words, such as 1 view or 5 views."""
    return f"{number} {noun}{'s' * (number != 1)}"


def depth_text(depth: float) -> str:
    """Return the shortest text that no other depth has: 1, 0.5, 1.0000001."""
    return repr(float(depth)).removesuffix(".0")

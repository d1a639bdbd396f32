"""Checks of a mapping from a file. They are nested like the mapping, and their errors name the
place of a wrong value.
"""

import math
from collections.abc import Callable, Mapping

Shape = Callable[[object, str], None]
"""A check of a value and its place in the file, such as settings.grid. It raises ValueError if the
value has another shape.
"""


def _shape_error(where: str, expected: str) -> ValueError:
    return ValueError(f"{where} is not {expected}")


def text(value: object, where: str) -> None:
    """Check for a text."""
    if not isinstance(value, str):
        raise _shape_error(where, "a text")


def flag(value: object, where: str) -> None:
    """Check for true or false."""
    if not isinstance(value, bool):
        raise _shape_error(where, "true or false")


def whole(value: object, where: str) -> None:
    """Check for a whole number."""
    if not isinstance(value, int) or isinstance(value, bool) or abs(value) > 10**15:
        raise _shape_error(where, "a whole number")


def number(value: object, where: str) -> None:
    """Check for a number. It may be infinite or NaN, which a fit writes for what it cannot
    estimate.
    """
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise _shape_error(where, "a number")
    if math.isfinite(value) and abs(value) > 1e100:
        raise _shape_error(where, "a number that a fit would leave")


def positive(value: object, where: str) -> None:
    """Check for a finite number above 0."""
    number(value, where)
    if not (isinstance(value, int | float) and 1e-100 <= value < math.inf):
        raise _shape_error(where, "a number above 0")


def count(value: object, where: str) -> None:
    """Check for a whole number of 0 or more."""
    whole(value, where)
    if isinstance(value, int) and value < 0:
        raise _shape_error(where, "a whole number of 0 or more")


def anything(_value: object, _where: str) -> None:
    """Accept any value, for entries that nobody reads."""


def choice(*allowed: str) -> Shape:
    """Return a check for one of the allowed texts."""

    def check(value: object, where: str) -> None:
        if value not in allowed:
            raise _shape_error(where, f"one of {', '.join(allowed)}")

    return check


def maybe(shape: Shape) -> Shape:
    """Return a check for null or a value of this shape."""

    def check(value: object, where: str) -> None:
        if value is not None:
            shape(value, where)

    return check


def many(shape: Shape, *, of: int | None = None) -> Shape:
    """Return a check for a list of such values, with `of` entries if that is given."""

    def check(value: object, where: str) -> None:
        if not isinstance(value, list | tuple) or of not in (None, len(value)):
            raise _shape_error(where, "a list" if of is None else f"a list of {of}")
        for index, entry in enumerate(value):
            shape(entry, f"{where}[{index}]")

    return check


def either(*shapes: Shape) -> Shape:
    """Return a check for a value of any of these shapes. The error is that of the last shape."""

    def check(value: object, where: str) -> None:
        for shape in shapes[:-1]:
            try:
                shape(value, where)
            except ValueError:
                continue
            return
        shapes[-1](value, where)

    return check


def table(shape: Shape) -> Shape:
    """Return a check for a mapping of any keys to such values."""

    def check(value: object, where: str) -> None:
        if not isinstance(value, Mapping):
            raise _shape_error(where, "a mapping")
        for key, entry in value.items():
            shape(entry, f"{where}.{str(key)[:40]}")

    return check


def record(required: Mapping[str, Shape], optional: Mapping[str, Shape] | None = None) -> Shape:
    """Return a check for a mapping with these keys. Other keys are not checked."""

    def check(value: object, where: str) -> None:
        if not isinstance(value, Mapping):
            raise _shape_error(where, "a mapping")
        prefix = f"{where}." if where else ""
        for key, shape in required.items():
            if key not in value:
                raise ValueError(f"{prefix}{key} is missing")
            shape(value[key], f"{prefix}{key}")
        for key, shape in (optional or {}).items():
            if key in value:
                shape(value[key], f"{prefix}{key}")

    return check

"""What a mapping from a file must look like: checks that are put together as its parts are, and say
where one is not as expected.
"""

import math
from collections.abc import Callable, Mapping

Shape = Callable[[object, str], None]
"""Of a value, and of where it stands, such as settings.grid: ValueError if the value is not of this
shape.
"""


def _wrong(where: str, expected: str) -> ValueError:
    return ValueError(f"{where} is not {expected}")


def text(value: object, where: str) -> None:
    if not isinstance(value, str):
        raise _wrong(where, "a text")


def flag(value: object, where: str) -> None:
    if not isinstance(value, bool):
        raise _wrong(where, "true or false")


def whole(value: object, where: str) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or abs(value) > 10**15:
        raise _wrong(where, "a whole number")


def number(value: object, where: str) -> None:
    """It may be infinite, or not a number, as what a fit could not tell."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise _wrong(where, "a number")
    if math.isfinite(value) and abs(value) > 1e100:
        raise _wrong(where, "a number that a fit would leave")


def positive(value: object, where: str) -> None:
    number(value, where)
    if not (isinstance(value, int | float) and 1e-100 <= value < math.inf):
        raise _wrong(where, "a number above 0")


def count(value: object, where: str) -> None:
    """A whole number of 0 or more."""
    whole(value, where)
    if isinstance(value, int) and value < 0:
        raise _wrong(where, "a whole number of 0 or more")


def anything(_value: object, _where: str) -> None:
    """Of what nobody reads."""


def choice(*allowed: str) -> Shape:
    """One of some texts."""

    def check(value: object, where: str) -> None:
        if value not in allowed:
            raise _wrong(where, f"one of {', '.join(allowed)}")

    return check


def maybe(shape: Shape) -> Shape:
    """That, or nothing."""

    def check(value: object, where: str) -> None:
        if value is not None:
            shape(value, where)

    return check


def many(shape: Shape, *, of: int | None = None) -> Shape:
    """A list; `of` as many."""

    def check(value: object, where: str) -> None:
        if not isinstance(value, list | tuple) or of not in (None, len(value)):
            raise _wrong(where, "a list" if of is None else f"a list of {of}")
        for index, one in enumerate(value):
            shape(one, f"{where}[{index}]")

    return check


def either(*shapes: Shape) -> Shape:
    """One of these; the last one's complaint counts."""

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
    """A mapping of any keys."""

    def check(value: object, where: str) -> None:
        if not isinstance(value, Mapping):
            raise _wrong(where, "a mapping")
        for key, one in value.items():
            shape(one, f"{where}.{str(key)[:40]}")

    return check


def record(required: Mapping[str, Shape], optional: Mapping[str, Shape] | None = None) -> Shape:
    """A mapping of these keys; others are not looked at."""

    def check(value: object, where: str) -> None:
        if not isinstance(value, Mapping):
            raise _wrong(where, "a mapping")
        inside = f"{where}." if where else ""
        for key, shape in required.items():
            if key not in value:
                raise ValueError(f"{inside}{key} is missing")
            shape(value[key], f"{inside}{key}")
        for key, shape in (optional or {}).items():
            if key in value:
                shape(value[key], f"{inside}{key}")

    return check

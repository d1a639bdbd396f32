"""Reading a mapping from a file strictly: what is wrong is said with file, key and what to write
instead.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TypeVar

from calib.errors import InputError, brief

T = TypeVar("T", int, str)
WIDEST = 1e100
"""The largest sigma, and one over it the smallest: a fit squares them."""


@dataclass(frozen=True, slots=True)
class Number:
    """A number of the set-up, in SI units or px."""

    value: float
    sigma: float = 0.0
    """How well it is known: the fit's prior. 0: not stated, or held."""
    exact: bool = False
    """Whether the fit holds it even where all numbers are freed, each by the tolerance of its kind
    (session/tolerances.py).
    """


UNITS = {"_mm": ("millimetres", 1000.0), "_deg": ("degrees", 180 / math.pi)}
"""What a key's suffix says: the unit, and how many of it make one SI unit."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number in a file, or a list of them: its key, and what it may be."""

    key: str
    """As the file writes it, with the unit as its suffix."""
    components: tuple[str, ...] = ()
    """The names of a list's entries. None: a single number."""
    low: float = -math.inf
    """The smallest allowed, in the file's unit; and `high` the largest. Both are given, or neither.
    """
    high: float = math.inf
    default: float | None = None
    """None: the key is required."""

    @property
    def names(self) -> tuple[str, ...]:
        """What its numbers are called inside: tilt_deg of x and z are tilt.x and tilt.z."""
        stem = re.sub("(_mm|_deg)$", "", self.key)
        return tuple(f"{stem}.{component}" for component in self.components) or (stem,)

    @property
    def unit(self) -> tuple[str, float]:
        return next(
            (unit for suffix, unit in UNITS.items() if self.key.endswith(suffix)), ("", 1.0)
        )

    @property
    def expected(self) -> str:
        """What to write for one of its numbers."""
        limits = f" from {self.low:g} to {self.high:g}" if self.low > -math.inf else ""
        return f"a number{limits}{f' in {self.unit[0]}' if self.unit[0] else ''}"

    def to_yaml(self, number: Number) -> object:
        """What to write so that reading it gives the number again."""
        value = self._written(number.value)
        if number.exact:
            return {"value": value, "exact": True}
        return {"value": value, "sigma": self._written(number.sigma)} if number.sigma else value

    def _written(self, si: float) -> float:
        """The shortest number that reads as this one.

        What was read from a file has one; of others, a few come back off in the last bit.
        """
        per_si = self.unit[1]
        near = si * per_si
        candidates = [
            float(f"{near:.15g}"),
            float(f"{near:.16g}"),
            near,
            math.nextafter(near, -math.inf),
            math.nextafter(near, math.inf),
        ]
        return next((written for written in candidates if written / per_si == si), near)


@dataclass(frozen=True, slots=True)
class Section:
    """A mapping in a file, which knows where it stands so that its complaints can say so."""

    values: Mapping[str, object]
    file: str
    path: str = ""

    def at(self, key: str) -> str:
        return f"{self.path}.{key}" if self.path else key

    def wrong(self, key: str, value: object, expected: str) -> InputError:
        if isinstance(value, str) and _is_number(value) and "number" in expected:
            return InputError(
                f'{self.file}: {self.at(key)} is the text "{brief(value)}": drop the quotes.'
            )
        return InputError(f"{self.file}: {self.at(key)} is {_shown(value)}: write {expected}.")

    def only(self, allowed: Sequence[str], kind: str = "known key") -> None:
        """Refuse any other key."""
        for key in self.values:
            if key not in allowed:
                close = get_close_matches(brief(key), allowed, n=1)
                hint = f" (did you mean {close[0]}?)" if close else ""
                raise InputError(
                    f"{self.file}: {self.at(brief(key))} is not a {kind}{hint}: allowed here are"
                    f" {', '.join(allowed)}."
                )

    def get(self, key: str, expected: str) -> object:
        if key not in self.values:
            raise InputError(f"{self.file}: {self.at(key)} is missing: write {expected}.")
        return self.values[key]

    def section(self, key: str, example: str) -> "Section":
        expected = f"a mapping, such as {example}"
        value = self.get(key, expected)
        if not isinstance(value, Mapping):
            raise self.wrong(key, value, expected)
        return Section(value, self.file, self.at(key))

    def text(self, key: str, expected: str, default: str | None = None) -> str:
        value = self.get(key, expected) if default is None else self.values.get(key, default)
        if not isinstance(value, str):
            raise self.wrong(key, value, f"{expected}, in quotes if need be")
        return value

    def whole(self, key: str, low: int, high: int) -> int:
        expected = f"a whole number from {low} to {high}"
        value = self.get(key, expected)
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            raise self.wrong(key, value, expected)
        return value

    def choice(self, key: str, options: Sequence[T], expected: str) -> T:
        value = self.get(key, expected)
        for option in options:
            if type(value) is type(option) and value == option:
                return option
        close = (
            get_close_matches(brief(value), [str(option) for option in options], n=1)
            if isinstance(value, str)
            else []
        )
        raise self.wrong(key, value, f"{close[0]}, or {expected}" if close else expected)

    def read(self, quantity: Quantity) -> dict[str, Number]:
        """The quantity's numbers in SI units, by the names they have inside."""
        key, names = quantity.key, quantity.names
        if key not in self.values and quantity.default is not None:
            return dict.fromkeys(names, Number(quantity.default / quantity.unit[1]))
        if not quantity.components:
            return {names[0]: self.number(key, self.get(key, quantity.expected), quantity)}
        expected = f"[{', '.join(quantity.components)}], each {quantity.expected}"
        value = self.get(key, expected)
        if not isinstance(value, list) or len(value) != len(names):
            raise self.wrong(key, value, expected)
        return {
            name: self.number(f"{key}[{i}]", entry, quantity)
            for i, (name, entry) in enumerate(zip(names, value, strict=True))
        }

    def number(self, key: str, written: object, quantity: Quantity) -> Number:
        """A plain number, {value:, sigma:} or {value:, exact: true}, in SI units."""
        per_si = quantity.unit[1]
        if not isinstance(written, Mapping):
            return Number(self._within(key, written, quantity) / per_si)
        pair = Section(written, self.file, self.at(key))
        pair.only(("value", "sigma", "exact"), "key of a number with a sigma")
        value = pair._within("value", pair.get("value", quantity.expected), quantity)
        exact = pair.values.get("exact", False)
        if not isinstance(exact, bool):
            raise pair.wrong("exact", exact, "true to hold the number, or drop the key")
        if exact and "sigma" not in pair.values:
            return Number(value / per_si, exact=True)
        expected = f"a number above 0, up to {WIDEST:g}, or 0 to hold the number"
        sigma = _plain(pair.get("sigma", expected))
        if sigma is None or not (sigma == 0 or 1 / WIDEST <= sigma <= WIDEST) or (exact and sigma):
            raise pair.wrong(
                "sigma",
                written["sigma"],
                "0, or drop it, as the number is exact" if exact else expected,
            )
        return Number(value / per_si, sigma / per_si, exact=not sigma)

    def _within(self, key: str, written: object, quantity: Quantity) -> float:
        value = _plain(written)
        if value is None:
            raise self.wrong(key, written, quantity.expected)
        if not quantity.low <= value <= quantity.high:
            metres = quantity.unit[0] == "millimetres" and 0 < value < quantity.low
            hint = f" ({value:g} m, if metres were meant, is {value * 1000:g})" if metres else ""
            raise self.wrong(key, written, quantity.expected + hint)
        return value


def _plain(value: object) -> float | None:
    """A finite number, which true and false are not."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _shown(value: object) -> str:
    match value:
        case None:
            return "empty"
        case bool():
            return str(value).lower()
        case str():
            return f'the text "{brief(value)}"'
        case list():
            return f"a list of {len(value)}"
        case Mapping():
            return "a mapping"
    return brief(repr(value))

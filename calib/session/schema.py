"""Read a mapping from a file strictly: an error names the file and the key, and says what to write
instead.
"""

import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from calib.errors import InputError, brief, meant
from calib.session.number_spelling import spelling_advice
from calib.session.tolerances import WidePrior

T = TypeVar("T", int, str)
MAX_SIGMAS_OUTSIDE = 3.0
"""Standard deviations by which an estimate may lie outside of the limits of its kind: the index of
air comes out below 1 half of the time.
"""
UNKNOWN = "unknown"
"""The word for a number, or a shape, that nobody knows."""
MAX_SIGMA = 1e100
"""The largest sigma; its reciprocal is the smallest. A fit squares both."""


@dataclass(frozen=True, slots=True)
class Number:
    """A number of the set-up in SI units or px."""

    value: float
    sigma: float = 0.0
    """The standard deviation of the fit's prior. 0: not stated, or held fixed."""
    exact: bool = False
    """True if the fit holds the number fixed even where all numbers are freed with the tolerances
    of their kinds (session/tolerances.py).
    """
    unknown: bool = False
    """True if nobody knows the number: value and sigma are the wide prior of its kind."""

    @staticmethod
    def of_prior(prior: WidePrior) -> "Number":
        """Return the number that nobody knows, with the wide prior of its kind."""
        return Number(prior.mean, prior.sigma, unknown=True)


UNITS = {"_mm": ("millimetres", 1000.0), "_deg": ("degrees", 180 / math.pi)}
"""The unit that a key's suffix names, and the number of these units in one SI unit."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """The key and the limits of a number in a file, or of a list of numbers."""

    key: str
    """The key in the file, with the unit as its suffix."""
    components: tuple[str, ...] = ()
    """The names of a list's entries. None: a single number."""
    low: float = -math.inf
    """The smallest allowed value in the file's unit; `high` is the largest. Both are given, or
    neither.
    """
    high: float = math.inf
    default: float | None = None
    """None: the key is required, or the number is unknown where the key is missing."""
    wide: WidePrior | None = None
    """The prior of each number if it is unknown, in SI units. None: it has to be known."""

    @property
    def stem(self) -> str:
        """The key without its unit."""
        return re.sub("(_mm|_deg)$", "", self.key)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its numbers in the program: tilt_deg of x and z has tilt.x and tilt.z."""
        return tuple(f"{self.stem}.{component}" for component in self.components) or (self.stem,)

    @property
    def unit(self) -> tuple[str, float]:
        """The unit's name, and the number of these units in one SI unit."""
        return next(
            (unit for suffix, unit in UNITS.items() if self.key.endswith(suffix)), ("", 1.0)
        )

    @property
    def expected(self) -> str:
        """The phrase that says what to write for one of its numbers."""
        limits = f" from {self.low:g} to {self.high:g}" if self.low > -math.inf else ""
        unit = f" in {self.unit[0]}" if self.unit[0] else ""
        return f"a number{limits}{unit}{f', or {UNKNOWN}' if self.wide else ''}"

    @property
    def unknown_numbers(self) -> dict[str, Number]:
        """The numbers by name if none is known; empty if they have to be known."""
        return dict.fromkeys(self.names, Number.of_prior(self.wide)) if self.wide else {}

    def to_yaml(self, number: Number) -> object:
        """Return the YAML value that is read as this number."""
        if number.unknown:
            return UNKNOWN
        value = self._shortest(number.value)
        if number.exact:
            return {"value": value, "exact": True}
        return {"value": value, "sigma": self._shortest(number.sigma)} if number.sigma else value

    def _shortest(self, si: float) -> float:
        """Return the shortest number in the file's unit that is read as this one.

        Every number that was read from a file has one; a few others are read with another last bit.
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
        return next((candidate for candidate in candidates if candidate / per_si == si), near)


@dataclass(frozen=True, slots=True)
class Section:
    """A mapping in a file that knows its place in it, for its error messages."""

    values: Mapping[str, object]
    file: str
    path: str = ""

    def key_path(self, key: str) -> str:
        """Return the key with the path of this mapping."""
        return f"{self.path}.{key}" if self.path else key

    def error(self, key: str, value: object, expected: str) -> InputError:
        """Return the error that the key has this value, and what to write instead."""
        if isinstance(value, str) and "number" in expected:
            has_sigma = expected.startswith("a number") and key != "sigma"
            is_whole = expected.startswith("a whole number")
            advice = spelling_advice(key, value, has_sigma=has_sigma, is_whole=is_whole)
            if advice:
                text = f'{self.file}: {self.key_path(key)} is the text "{brief(value)}"'
                return InputError(f"{text}: {advice}.")
        return InputError(
            f"{self.file}: {self.key_path(key)} is {_describe(value)}: write {expected}."
        )

    def allow_only(
        self,
        allowed: Sequence[str],
        kind: str = "known key",
        inner: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Raise InputError if the mapping has any other key.

        Args:
            kind: what the key is not, in the message.
            inner: the keys of the mappings within this one, by the key of the mapping: they stand
                here where their indentation is missing.
        """
        for key in self.values:
            if key not in allowed:
                if advice := self._spelling_advice(key, allowed):
                    raise InputError(
                        f"{self.file}: {self.key_path(brief(key))} is no key: {advice}."
                    )
                outer = next((name for name, keys in (inner or {}).items() if key in keys), "")
                if outer:
                    raise InputError(
                        f"{self.file}: {self.key_path(key)} is a key of {self.key_path(outer)}:"
                        f" indent its line by two blanks more than {outer}."
                    )
                close = meant(key, allowed)
                hint = f" (did you mean {close}?)" if close else ""
                raise InputError(
                    f"{self.file}: {self.key_path(brief(key))} is not a {kind}{hint}: allowed here"
                    f" are {', '.join(allowed)}."
                )

    def _spelling_advice(self, key: str, allowed: Sequence[str]) -> str:
        """Return what to write in place of a key that came of a missing blank or a decimal comma;
        empty if it came of something else.
        """
        name, colon, value = key.partition(":")
        if colon and name.strip() in allowed:
            blank = unicodedata.name(value[:1], "").lower() if value[:1].isspace() else ""
            exception = f", not a {blank}" if blank else ""
            pair = f"{name.strip()}: {brief(value.strip())}"
            return f"write {pair}, with a space behind the colon{exception}"
        keys = list(self.values)
        previous = keys[keys.index(key) - 1]
        number = self.values[previous]
        if key.isdecimal() and self.values[key] is None and type(number) is int:
            return f"write {previous}: {number}.{key} with a decimal point"
        return ""

    def get(self, key: str, expected: str) -> object:
        """Return the value; raise InputError if the key is missing."""
        if key not in self.values:
            similar = next((name for name in self.values if name.lower() == key), "")
            if similar:
                raise InputError(
                    f"{self.file}: {self.key_path(similar)} is no key: write it in small letters,"
                    f" {key}."
                )
            raise InputError(f"{self.file}: {self.key_path(key)} is missing: write {expected}.")
        return self.values[key]

    def section(self, key: str, example: str) -> "Section":
        """Return the mapping under a key; `example` is quoted where it is missing."""
        expected = f"a mapping, such as {example}"
        value = self.get(key, expected)
        if not isinstance(value, Mapping):
            raise self.error(key, value, expected)
        return Section(value, self.file, self.key_path(key))

    def text(self, key: str, expected: str, default: str | None = None) -> str:
        """Return a text; required unless there is a default."""
        value = self.get(key, expected) if default is None else self.values.get(key, default)
        if not isinstance(value, str):
            raise self.error(key, value, f"{expected}, in quotes if need be")
        return value

    def integer(self, key: str, low: int, high: int) -> int:
        """Return a whole number from `low` to `high`."""
        expected = f"a whole number from {low} to {high}"
        value = self.get(key, expected)
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            raise self.error(key, value, expected)
        return value

    def choice(self, key: str, options: Sequence[T], expected: str) -> T:
        """Return the option that the key names."""
        value = self.get(key, expected)
        for option in options:
            if type(value) is type(option) and value == option:
                return option
        texts = [str(option) for option in options]
        if isinstance(value, str) and value in texts:
            raise self.error(key, value, f"{value} without quotes")
        close = meant(value, texts) if isinstance(value, str) else ""
        raise self.error(key, value, f"{close}, or {expected}" if close else expected)

    def read(self, quantity: Quantity) -> dict[str, Number]:
        """Return the quantity's numbers in SI units, by their names in the program."""
        key, names = quantity.key, quantity.names
        if key not in self.values and quantity.default is not None:
            return dict.fromkeys(names, Number(quantity.default / quantity.unit[1]))
        if quantity.wide and is_unknown(self.values.get(key, UNKNOWN)):
            return quantity.unknown_numbers
        if not quantity.components:
            return {names[0]: self.number(key, self.get(key, quantity.expected), quantity)}
        expected = f"[{', '.join(quantity.components)}], each {quantity.expected}"
        value = self.get(key, expected)
        if not isinstance(value, list) or len(value) != len(names):
            raise self.error(key, value, expected)
        return {
            name: self.number(f"{key}[{i}]", entry, quantity)
            for i, (name, entry) in enumerate(zip(names, value, strict=True))
        }

    def number(self, key: str, written: object, quantity: Quantity) -> Number:
        """Return a number in SI units, written plainly, as {value:, sigma:}, as {value:, exact:
        true} or as unknown.
        """
        if quantity.wide and is_unknown(written):
            return Number.of_prior(quantity.wide)
        per_si = quantity.unit[1]
        if not isinstance(written, Mapping):
            return Number(self._limited_value(key, written, quantity) / per_si)
        pair = Section(written, self.file, self.key_path(key))
        pair.allow_only(("value", "sigma", "exact"), "key of a number with a sigma")
        uncertainty = _finite_number(pair.values.get("sigma")) or 0.0
        slack = MAX_SIGMAS_OUTSIDE * max(0.0, uncertainty)
        value = pair._limited_value("value", pair.get("value", quantity.expected), quantity, slack)
        exact = pair.values.get("exact", False)
        if not isinstance(exact, bool):
            raise pair.error("exact", exact, "true if it is not to be fitted, or drop the key")
        if exact and "sigma" not in pair.values:
            return Number(value / per_si, exact=True)
        expected = f"a number above 0, up to {MAX_SIGMA:g}, or 0 if it is not to be fitted"
        sigma = _finite_number(pair.get("sigma", expected))
        if (
            sigma is None
            or not (sigma == 0 or 1 / MAX_SIGMA <= sigma <= MAX_SIGMA)
            or (exact and sigma)
        ):
            raise pair.error(
                "sigma",
                written["sigma"],
                "0, or drop it, as the number is exact" if exact else expected,
            )
        return Number(value / per_si, sigma / per_si, exact=not sigma)

    def _limited_value(
        self, key: str, written: object, quantity: Quantity, slack: float = 0.0
    ) -> float:
        """Return a finite number within the quantity's limits, in the file's unit. It may be
        outside of them by `slack`, but a positive number stays positive.
        """
        value = _finite_number(written)
        if value is None:
            raise self.error(key, written, quantity.expected)
        is_signed = quantity.low <= 0 or value > 0
        if not (quantity.low - slack <= value <= quantity.high + slack and is_signed):
            metres = quantity.unit[0] == "millimetres" and 0 < value < quantity.low
            hint = f" ({value:g} m, if metres were meant, is {value * 1000:g})" if metres else ""
            raise self.error(key, written, quantity.expected + hint)
        return value


def is_unknown(written: object) -> bool:
    """Return True for the word that stands for a number that nobody knows."""
    return isinstance(written, str) and written.strip().lower() == UNKNOWN


def _finite_number(value: object) -> float | None:
    """Return the value if it is a finite number, else None; true and false are no numbers."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _describe(value: object) -> str:
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

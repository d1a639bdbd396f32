"""Numbers of the model that differ from what the fit holds: each is moved by one of the effect's own."""

from collections.abc import Mapping
from dataclasses import dataclass

from torch import Tensor

from calib.effects.effect import Unknown
from calib.optics.params import Param, Values


@dataclass(frozen=True, slots=True)
class Offsets:
    """Adds the effect's numbers to the stages' own."""

    moved: tuple[tuple[str, Param], ...]
    """The stage's number, and what is added to it."""

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(param for _, param in self.moved)

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        return pixels, {**values, **{name: values[name] + values[param.name] for name, param in self.moved}}


def offsets(effect: str, numbers: Mapping[str, tuple[str, float, float]]) -> tuple[Offsets, tuple[Unknown, ...]]:
    """The adjustment and its unknowns; numbers are those of stages, each with its unit, scale and prior sigma."""
    moved = tuple((name, Param(f"{effect}.{name.split('.', 1)[1]}", unit, scale)) for name, (unit, scale, _) in numbers.items())
    return Offsets(moved), tuple(Unknown(param, numbers[name][2]) for name, param in moved)

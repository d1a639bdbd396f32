"""Parameters of the stages that differ from what the fit holds: to each, one of the effect's own is
added.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from torch import Tensor

from calib.effects.effect import Unknown
from calib.optics.params import Param, Values
from calib.session.tolerances import Tolerance


@dataclass(frozen=True, slots=True)
class Offsets:
    """Adds the effect's parameters to the stages' own."""

    unknowns: tuple[Unknown, ...]

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(unknown.param for unknown in self.unknowns)

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        return pixels, shifted(values, self.unknowns)


def shifted(values: Values, unknowns: Iterable[Unknown]) -> Values:
    """Every number that the unknowns are increments of, with its increment."""
    moved = dict(values)
    for unknown in unknowns:
        change = values[unknown.param.name]
        for name in unknown.shifts:
            moved[name] = values[name] * (1 + change) if unknown.relative else values[name] + change
    return moved


def increments(effect: str, parameters: Mapping[str, Tolerance]) -> tuple[Unknown, ...]:
    """An unknown of the effect for each of some of the stages' parameters."""
    return tuple(
        Unknown.of(f"{effect}.{name.split('.', 1)[1]}", tolerance, (name,))
        for name, tolerance in parameters.items()
    )

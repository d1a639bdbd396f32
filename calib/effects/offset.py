"""Parameters of the stages that differ from what the fit holds: to each, one of the effect's own is added."""

from collections.abc import Mapping
from dataclasses import dataclass

from torch import Tensor

from calib.effects.effect import Unknown
from calib.optics.params import Param, Values
from calib.session.tolerances import Tolerance


@dataclass(frozen=True, slots=True)
class Offsets:
    """Adds the effect's parameters to the stages' own."""

    moved: tuple[tuple[str, Param], ...]
    """The stage's parameter, and what is added to it."""

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(param for _, param in self.moved)

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        return pixels, {**values, **{name: values[name] + values[param.name] for name, param in self.moved}}


def offsets(effect: str, parameters: Mapping[str, Tolerance]) -> tuple[Offsets, tuple[Unknown, ...]]:
    """The adjustment of some of the stages' parameters, and its unknowns."""
    unknowns = {name: Unknown.of(f"{effect}.{name.split('.', 1)[1]}", tolerance) for name, tolerance in parameters.items()}
    return Offsets(tuple((name, unknown.param) for name, unknown in unknowns.items())), tuple(unknowns.values())

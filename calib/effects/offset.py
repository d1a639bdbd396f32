"""Increments of stage parameters: an effect's parameter is added to a value that the fit otherwise
holds constant.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from torch import Tensor

from calib.effects.effect import EffectParameter
from calib.optics.exposure import Exposure
from calib.optics.params import Param, Values
from calib.session.parameter_names import COVER
from calib.session.tolerances import Tolerance


@dataclass(frozen=True, slots=True)
class Offsets:
    """An adjustment that adds the effect's parameters to the stages' values."""

    effect_parameters: tuple[EffectParameter, ...]

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(parameter.param for parameter in self.effect_parameters)

    def __call__(
        self, pixels: Tensor, values: Values, _exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]:
        return pixels, add_increments(values, self.effect_parameters)


def add_increments(values: Values, effect_parameters: Iterable[EffectParameter]) -> Values:
    """Return the values, with each increment added to the values that it shifts."""
    shifted = dict(values)
    for parameter in effect_parameters:
        change = values[parameter.param.name]
        for name in parameter.shifts:
            shifted[name] = (
                values[name] * (1 + change) if parameter.relative else values[name] + change
            )
    return shifted


def increments(effect: str, parameters: Mapping[str, Tolerance]) -> tuple[EffectParameter, ...]:
    """Return a parameter of the effect for each of these numbers of the cover, as its increment:
    thickness.thickness for cover.thickness, thickness.cover2.thickness for cover2.thickness.
    """
    return tuple(
        EffectParameter.of(f"{effect}.{name.removeprefix(f'{COVER.part}.')}", tolerance, (name,))
        for name, tolerance in parameters.items()
    )
